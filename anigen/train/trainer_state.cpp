#include <map>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/random.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/tensor_arrays.h"
#include "anigen/train/generator_state.h"
#include "anigen/train/model_weights.h"
#include "anigen/train/trainer.h"
#include "anigen/train/warm_start.h"

// What a run starts from and what it leaves behind; the loop is in trainer.cpp.
namespace anigen::train {
namespace {

// Of LibTorch's own generator, in a saved state.
std::string generator_name(std::size_t rank) {
  return rank == 0 ? std::string("rng.torch") : "rng.torch.rank" + std::to_string(rank);
}

}  // namespace

void Trainer::check_finetuned_models() const {
  std::map<std::string, std::string> unknown = options_.finetune_ckpt;
  for (const NamedModel& model : stages_.front()->models()) unknown.erase(model.name);
  if (unknown.empty()) return;
  throw InputError("", "trainer/args/finetune_ckpt/" + unknown.begin()->first, "there is no model of that name");
}

void Trainer::start_from_files() {
  LoadedKeys finetuned;
  for (const NamedModel& model : stages_.front()->models()) {
    const auto file = options_.finetune_ckpt.find(model.name);
    if (file == options_.finetune_ckpt.end()) continue;
    finetuned[model.name] = load_matching(*model.module, io::read_state_dict(file->second), file->second);
  }
  stages_.front()->warm_start(finetuned);
}

std::optional<std::int64_t> Trainer::step_to_restore(const CheckpointFolder& source) const {
  if (run_.ckpt == "none") return std::nullopt;
  if (run_.ckpt == "latest") {
    const std::optional<std::int64_t> latest = source.latest();
    if (!latest && !run_.load.empty()) throw InputError(run_.load.string(), "ckpts", "holds no complete checkpoint");
    return latest;
  }
  if (run_.ckpt.empty() || run_.ckpt.size() > 15 || run_.ckpt.find_first_not_of("0123456789") != std::string::npos) {
    throw InputError("--ckpt", run_.ckpt, "expected latest, none or a step");
  }
  const std::int64_t step = std::stoll(run_.ckpt);
  if (!source.complete(step))
    throw InputError(source.file("state", step).string(), "", "there is no complete checkpoint of this step");
  return step;
}

void Trainer::restore(const CheckpointFolder& source, std::int64_t step) {
  for (const NamedModel& model : stages_.front()->models()) {
    set_weights(model, buffers_.front(), buffers_.front().master(), source.weights(model.name, step),
                source.file(model.name, step).string());
    for (std::size_t i = 0; i < update_->ema.rates().size(); ++i) {
      const std::string name = ema_name(model.name, update_->ema.rates()[i]);
      // A rate that was added since then starts from the weights.
      const std::string from = source.has(name, step) ? name : model.name;
      set_weights(model, buffers_.front(), update_->ema.averages()[i], source.weights(from, step),
                  source.file(from, step).string());
    }
  }
  for (ParameterBuffer& buffer : buffers_) buffer.publish();
  restore_state(source.state(step));
  if (step_ != step) throw InputError(source.file("state", step).string(), "step", "belongs to another step");
  saved_step_ = run_.load.empty() ? step_ : -1;
  log::info("resumed from step {} ({} samples seen)", step_, samples_);
}

// Rank 0 decides from which step, since it may see a folder that another machine does not see yet.
std::optional<std::int64_t> Trainer::agreed_on(const std::optional<std::int64_t>& step_of_rank_0) {
  const std::string said = ranks_->gather(step_of_rank_0 ? std::to_string(*step_of_rank_0) : "").front();
  return said.empty() ? std::nullopt : std::optional<std::int64_t>(std::stoll(said));
}

// Sums move to rank 0, which logs and saves them.
void Trainer::bring_means_together() {
  if (alone()) return;
  Json own = Json::array();
  for (const RunningMeans::Entry& entry : means_.entries_) own.push_back({entry.name, entry.sum, entry.count});
  const std::vector<std::string> all = ranks_->gather(first() ? "" : own.dump());
  if (!first()) {
    means_.clear();
    return;
  }
  for (std::size_t rank = 1; rank < all.size(); ++rank) {
    for (const Json& entry : parse_json(all[rank], "rank " + std::to_string(rank))) {
      means_.add_sum({entry.at(0).get<std::string>(), entry.at(1).get<double>(), entry.at(2).get<std::int64_t>()});
    }
  }
}

void Trainer::save() {
  if (saved_step_ == step_) return;
  bring_means_together();
  const std::vector<std::string> generators = ranks_->gather(generator_state());
  generator_saved_ = generators[static_cast<std::size_t>(ranks_->rank())];
  if (first()) write_checkpoint(generators);
  saved_step_ = step_;
}

// Weights and moments are those of the last step that all ranks completed: an update follows only after every exchange
// of its step. What other ranks had to add to the logged means is lost.
void Trainer::save_what_is_complete() noexcept {
  if (!first() || saved_step_ == step_) return;
  try {
    // Where a stage draws from LibTorch's generator the checkpoint would need the other ranks' states, too.
    if (generator_then_.empty() || generator_then_ != generator_saved_) return;
    write_checkpoint({generator_then_});
    saved_step_ = step_;
    log::warn("saved step {}, the last one that all ranks completed", step_);
  } catch (const std::exception& problem) {
    log::warn("step {} could not be saved: {}", step_, problem.what());
  }
}

void Trainer::write_checkpoint(const std::vector<std::string>& generators) {
  const BusyRank busy(*ranks_, step_);
  WeightFiles files;
  for (const NamedModel& model : stages_.front()->models()) {
    files.emplace_back(model.name, weights_of(model, buffers_.front(), buffers_.front().master()));
    for (std::size_t i = 0; i < update_->ema.rates().size(); ++i) {
      files.emplace_back(ema_name(model.name, update_->ema.rates()[i]),
                         weights_of(model, buffers_.front(), update_->ema.averages()[i]));
    }
  }
  checkpoints_.save(step_, files, state(generators));
}

SavedState Trainer::state(const std::vector<std::string>& generators) const {
  SavedState saved;
  saved.arrays.emplace_back("optimizer.exp_avg", models::to_array(update_->optimizer.exp_avg));
  saved.arrays.emplace_back("optimizer.exp_avg_sq", models::to_array(update_->optimizer.exp_avg_sq));
  if (update_->muon) saved.arrays.emplace_back("optimizer.momentum", models::to_array(update_->muon->momentum));
  for (std::size_t rank = 0; rank < generators.size(); ++rank) {
    const std::string& bytes = generators[rank];
    saved.arrays.emplace_back(generator_name(rank),
                              io::NdArray::from(std::vector<std::uint8_t>(bytes.begin(), bytes.end()),
                                                {static_cast<std::int64_t>(bytes.size())}));
  }
  saved.numbers = {{"step", step_},
                   {"samples", samples_},
                   {"seed", options_.seed},
                   {"optimizer_steps", update_->optimizer.steps},
                   {"log_scale", update_->log_scale},
                   {"elapsed_s", elapsed()},
                   {"threads", run_.threads},
                   {"replicas", options_.replicas},
                   {"ranks", ranks_->size()}};
  if (update_->clipper) {
    const AdaptiveGradClipper::State& clip = update_->clipper->state();
    saved.arrays.emplace_back("grad_clip.buffer",
                              io::NdArray::from(clip.buffer, {static_cast<std::int64_t>(clip.buffer.size())}));
    saved.numbers["grad_clip"] = {{"threshold", clip.threshold}, {"pointer", clip.pointer}, {"length", clip.length}};
  }
  if (update_->recovery.belongs_to_state(step_)) {
    saved.arrays.emplace_back("recovery.master", models::to_array(update_->recovery.master()));
    saved.numbers["recovery_step"] = update_->recovery.step();
  }
  Json means = Json::array();
  for (const RunningMeans::Entry& entry : means_.entries_) means.push_back({entry.name, entry.sum, entry.count});
  saved.numbers["running_means"] = means;
  return saved;
}

void Trainer::restore_generator(const SavedState& saved) {
  if (const io::NdArray* state = io::find(saved.arrays, generator_name(static_cast<std::size_t>(ranks_->rank())))) {
    set_generator_state(std::string(state->bytes.begin(), state->bytes.end()));
  } else if (!first()) {
    // A rank that had no state yet draws other numbers than any rank before.
    constexpr std::uint64_t kMostRanks = 1 << 16;
    const std::uint64_t number =
        static_cast<std::uint64_t>(step_) * kMostRanks + static_cast<std::uint64_t>(ranks_->rank());
    torch::manual_seed(Rng(options_.seed, "generator of a rank", number).next());
  }
}

void Trainer::restore_state(const SavedState& saved) {
  const auto tensor = [&](const char* name) {
    const io::NdArray* array = io::find(saved.arrays, name);
    if (array == nullptr) throw InputError("", name, "is missing from the saved state");
    return models::to_tensor(*array);
  };
  const auto moments = [&](torch::Tensor& into, const char* name) {
    const torch::Tensor value = tensor(name);
    if (value.sizes() != into.sizes()) throw InputError("", name, "was saved for another number of parameters");
    into.copy_(value);
  };
  moments(update_->optimizer.exp_avg, "optimizer.exp_avg");
  moments(update_->optimizer.exp_avg_sq, "optimizer.exp_avg_sq");
  if (update_->muon) moments(update_->muon->momentum, "optimizer.momentum");
  const bool recovery = saved.numbers.contains("recovery_step");
  torch::Tensor recovery_master = torch::empty_like(buffers_.front().master());
  if (recovery) moments(recovery_master, "recovery.master");
  static_cast<void>(tensor(generator_name(0).c_str()));  // must be there
  const Json& numbers = saved.numbers;
  try {
    step_ = numbers.at("step").get<std::int64_t>();
    samples_ = numbers.at("samples").get<std::uint64_t>();
    restore_generator(saved);
    update_->optimizer.steps = numbers.at("optimizer_steps").get<std::int64_t>();
    update_->log_scale = numbers.at("log_scale").get<double>();
    if (recovery) update_->recovery.restore(numbers.at("recovery_step").get<std::int64_t>(), recovery_master);
    elapsed_before_ = numbers.at("elapsed_s").get<double>();
    if (numbers.at("seed").get<std::uint64_t>() != options_.seed)
      log::warn("the seed differs from the one this run began with");
    if (numbers.at("threads").get<int>() != run_.threads ||
        numbers.at("replicas").get<std::size_t>() != options_.replicas || numbers.value("ranks", 1) != ranks_->size()) {
      log::warn("this run began with {} threads, {} replicas and {} ranks; the last bits may differ now",
                numbers.at("threads").dump(), numbers.at("replicas").dump(), numbers.value("ranks", 1));
    }
    if (update_->clipper && numbers.contains("grad_clip")) {
      const Json& clip = numbers.at("grad_clip");
      AdaptiveGradClipper::State state;
      state.buffer = io::find(saved.arrays, "grad_clip.buffer")
                         ? io::find(saved.arrays, "grad_clip.buffer")->as<float>()
                         : std::vector<float>();
      if (!clip.at("threshold").is_null()) state.threshold = clip.at("threshold").get<double>();
      state.pointer = clip.at("pointer").get<std::size_t>();
      state.length = clip.at("length").get<std::size_t>();
      update_->clipper->restore(state);
    }
    means_.clear();
    const Json none = Json::array();
    for (const Json& entry : first() ? numbers.at("running_means") : none) {
      means_.entries_.push_back(
          {entry.at(0).get<std::string>(), entry.at(1).get<double>(), entry.at(2).get<std::int64_t>()});
    }
  } catch (const nlohmann::json::exception& error) {
    throw InputError("", "state", std::string("the saved state is damaged: ") + error.what());
  }
}

}  // namespace anigen::train
