#include <ATen/CPUGeneratorImpl.h>

#include <map>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/tensor_arrays.h"
#include "anigen/train/model_weights.h"
#include "anigen/train/trainer.h"
#include "anigen/train/warm_start.h"

// What a run starts from and what it leaves behind; the loop is in trainer.cpp.
namespace anigen::train {

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

void Trainer::save() {
  if (saved_step_ == step_) return;
  WeightFiles files;
  for (const NamedModel& model : stages_.front()->models()) {
    files.emplace_back(model.name, weights_of(model, buffers_.front(), buffers_.front().master()));
    for (std::size_t i = 0; i < update_->ema.rates().size(); ++i) {
      files.emplace_back(ema_name(model.name, update_->ema.rates()[i]),
                         weights_of(model, buffers_.front(), update_->ema.averages()[i]));
    }
  }
  checkpoints_.save(step_, files, state());
  saved_step_ = step_;
}

SavedState Trainer::state() const {
  SavedState saved;
  saved.arrays.emplace_back("optimizer.exp_avg", models::to_array(update_->optimizer.exp_avg));
  saved.arrays.emplace_back("optimizer.exp_avg_sq", models::to_array(update_->optimizer.exp_avg_sq));
  if (update_->muon) saved.arrays.emplace_back("optimizer.momentum", models::to_array(update_->muon->momentum));
  saved.arrays.emplace_back("rng.torch", models::to_array(at::detail::getDefaultCPUGenerator().get_state()));
  saved.numbers = {{"step", step_},
                   {"samples", samples_},
                   {"seed", options_.seed},
                   {"optimizer_steps", update_->optimizer.steps},
                   {"log_scale", update_->log_scale},
                   {"elapsed_s", elapsed()},
                   {"threads", run_.threads},
                   {"replicas", options_.replicas}};
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
  at::Generator generator = at::detail::getDefaultCPUGenerator();
  generator.set_state(tensor("rng.torch"));
  const Json& numbers = saved.numbers;
  try {
    step_ = numbers.at("step").get<std::int64_t>();
    samples_ = numbers.at("samples").get<std::uint64_t>();
    update_->optimizer.steps = numbers.at("optimizer_steps").get<std::int64_t>();
    update_->log_scale = numbers.at("log_scale").get<double>();
    if (recovery) update_->recovery.restore(numbers.at("recovery_step").get<std::int64_t>(), recovery_master);
    elapsed_before_ = numbers.at("elapsed_s").get<double>();
    if (numbers.at("seed").get<std::uint64_t>() != options_.seed)
      log::warn("the seed differs from the one this run began with");
    if (numbers.at("threads").get<int>() != run_.threads ||
        numbers.at("replicas").get<std::size_t>() != options_.replicas) {
      log::warn("this run began with {} threads and {} replicas; the last bits may differ now",
                numbers.at("threads").dump(), numbers.at("replicas").dump());
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
    for (const Json& entry : numbers.at("running_means")) {
      means_.entries_.push_back(
          {entry.at(0).get<std::string>(), entry.at(1).get<double>(), entry.at(2).get<std::int64_t>()});
    }
  } catch (const nlohmann::json::exception& error) {
    throw InputError("", "state", std::string("the saved state is damaged: ") + error.what());
  }
}

}  // namespace anigen::train
