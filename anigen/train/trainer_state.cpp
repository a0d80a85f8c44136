#include "anigen/train/trainer_state.h"

#include <ATen/CPUGeneratorImpl.h>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <set>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/random.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/data/metadata.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/torch.h"
#include "anigen/train/metrics_log.h"
#include "anigen/train/parameters.h"
#include "anigen/train/trainer.h"
#include "anigen/train/warm_start.h"

// Starting point and checkpoints of a run; the loop is in trainer.cpp.

namespace anigen::train {

namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kKeepEvery = 100'000;
constexpr std::size_t kKeepNewest = 2;
constexpr char kState[] = "state";
constexpr char kExtension[] = ".safetensors";

// The step of "<name>_step0000100.safetensors"; nothing for other files, temporary ones among them.
std::optional<std::int64_t> step_of(const std::string& file) {
  const std::size_t mark = file.rfind("_step");
  if (mark == std::string::npos) return std::nullopt;
  const std::size_t begin = mark + 5, end = file.find_first_not_of("0123456789", begin);
  if (end == begin || end == std::string::npos || end - begin > 18 || file.substr(end) != kExtension)
    return std::nullopt;
  return std::stoll(file.substr(begin, end - begin));
}

bool is_state(const std::string& file) {
  return file.rfind(std::string(kState) + "_step", 0) == 0 && step_of(file).has_value();
}

bool temporary(const std::string& file) { return file.find(".tmp-") != std::string::npos; }

std::vector<std::string> files_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

// The step of "step240", a folder of samples.
std::optional<std::int64_t> step_of_samples(const std::string& folder) {
  constexpr std::size_t kWord = 4;
  const std::string digits = folder.substr(std::min(kWord, folder.size()));
  if (folder.rfind("step", 0) != 0 || digits.empty() || digits.size() > 18) return std::nullopt;
  if (digits.find_first_not_of("0123456789") != std::string::npos) return std::nullopt;
  return std::stoll(digits);
}

fs::path new_abandoned_folder(const fs::path& checkpoints, std::int64_t first) {
  make_folders(checkpoints);
  std::error_code error;
  for (int number = 1; !error; ++number) {
    const fs::path folder = checkpoints / ("abandoned-" + std::to_string(first) + "-" + std::to_string(number));
    if (fs::create_directory(folder, error)) return folder;
  }
  throw Error(checkpoints.string() + ": cannot create a folder: " + error.message());
}

// Of LibTorch's own generator, in a saved state.
std::string generator_name(std::size_t rank) {
  return rank == 0 ? std::string("rng.torch") : "rng.torch.rank" + std::to_string(rank);
}

// The options of a command line that say where to begin.
std::string told_start(const RunOptions& run) {
  std::string text = run.load.empty() ? "" : "--load " + run.load.string();
  if (run.ckpt != "latest") text += (text.empty() ? "--ckpt " : " --ckpt ") + run.ckpt;
  return text;
}

// A checkpoint of the output is its own also when --load names the folder.
bool loads_another_run(const RunOptions& run) {
  std::error_code error;
  return !run.load.empty() && !std::filesystem::equivalent(run.load, run.output, error);
}

// Weights without the state of a training, such as export_run() writes.
bool loads_weights_alone(const RunOptions& run) {
  if (run.ckpt != "latest" || !loads_another_run(run)) return false;
  const fs::path files = checkpoint_files_of(run.load);
  return !CheckpointFolder(files).holds_states() && !io::checkpoint_names(files).empty();
}

std::optional<std::int64_t> step_to_load(const CheckpointFolder& source, const RunOptions& run) {
  if (run.ckpt == "none" || loads_weights_alone(run)) return std::nullopt;
  if (run.ckpt == "latest") {
    const std::optional<std::int64_t> latest = source.latest();
    if (!latest && !run.load.empty()) throw InputError(run.load.string(), "ckpts", "holds no complete checkpoint");
    return latest;
  }
  const std::int64_t step = std::stoll(run.ckpt);
  if (source.complete(step)) return step;
  const std::string others = joined(source.steps());
  throw InputError(source.file("state", step).string(), "",
                   "there is no complete checkpoint of this step, only of " + (others.empty() ? "none" : others));
}

// @throws c10::Error for bytes that are no such state
void set_generator_state(const std::string& bytes) {
  const torch::Tensor state = torch::empty({static_cast<std::int64_t>(bytes.size())}, torch::kUInt8);
  std::memcpy(state.data_ptr(), bytes.data(), bytes.size());
  at::Generator generator = at::detail::getDefaultCPUGenerator();
  generator.set_state(state);
}

}  // namespace

std::string ema_name(const std::string& model, double rate) { return model + "_ema" + Json(rate).dump(); }

fs::path CheckpointFolder::file(const std::string& name, std::int64_t step) const {
  char digits[32];
  std::snprintf(digits, sizeof digits, "%07lld", static_cast<long long>(step));
  return folder_ / (name + "_step" + digits + kExtension);
}

void CheckpointFolder::save(std::int64_t step, const WeightFiles& weights, const SavedState& state) const {
  // An older set of the same step stops being valid before its files are replaced.
  remove_lastingly(file(kState, step));
  const std::map<std::string, std::string> stamp = {{"made_by", made_by().dump()}};
  Json sizes = Json::object();
  for (const auto& [name, arrays] : weights) {
    const fs::path path = file(name, step);
    io::write_safetensors(path, arrays, stamp);
    sizes[path.filename().string()] = fs::file_size(path);
  }
  const Json entry{{"step", step}, {"files", sizes}, {"numbers", state.numbers}};
  io::write_safetensors(file(kState, step), state.arrays, {{"state", entry.dump()}, *stamp.begin()});
  clean_up(step);
  if (complete(step)) return;
  throw Error(file(kState, step).string() + ": the checkpoint of step " + std::to_string(step) +
              " is not there after it was written; does another program work in this folder?");
}

bool CheckpointFolder::complete(std::int64_t step) const {
  std::error_code error;
  if (!fs::exists(file(kState, step), error)) return false;
  try {
    const auto metadata = io::read_safetensors_metadata(file(kState, step));
    const Json entry = parse_json(metadata.at("state"), file(kState, step).string());
    for (const auto& [name, size] : entry.at("files").items()) {
      const std::uintmax_t actual = fs::file_size(folder_ / name, error);
      if (error || actual != size.get<std::uintmax_t>()) return false;
    }
    return true;
  } catch (const std::exception& problem) {
    log::warn("checkpoint of step {} is not usable: {}", step, problem.what());
    return false;
  }
}

// Steps that have a state, ascending.
std::vector<std::int64_t> CheckpointFolder::stated_steps() const {
  std::set<std::int64_t> found;
  for (const std::string& name : files_in(folder_)) {
    if (is_state(name)) found.insert(*step_of(name));
  }
  return {found.begin(), found.end()};
}

std::vector<std::int64_t> CheckpointFolder::steps() const {
  std::vector<std::int64_t> found = stated_steps();
  found.erase(std::remove_if(found.begin(), found.end(), [this](std::int64_t step) { return !complete(step); }),
              found.end());
  return found;
}

std::optional<std::int64_t> CheckpointFolder::latest() const {
  const std::vector<std::int64_t> all = stated_steps();
  const auto newest = std::find_if(all.rbegin(), all.rend(), [this](std::int64_t step) { return complete(step); });
  return newest == all.rend() ? std::nullopt : std::optional<std::int64_t>(*newest);
}

bool CheckpointFolder::has(const std::string& name, std::int64_t step) const {
  std::error_code error;
  return fs::exists(file(name, step), error);
}

io::NamedArrays CheckpointFolder::weights(const std::string& name, std::int64_t step) const {
  return io::read_safetensors(file(name, step)).tensors;
}

SavedState CheckpointFolder::state(std::int64_t step) const {
  const fs::path path = file(kState, step);
  io::SafetensorsFile read = io::read_safetensors(path);
  const auto entry = read.metadata.find("state");
  if (entry == read.metadata.end()) throw InputError(path.string(), "__metadata__", "has no entry 'state'");
  const Json json = parse_json(entry->second, path.string());
  if (!json.is_object() || !json.contains("numbers"))
    throw InputError(path.string(), "__metadata__/state", "is damaged");
  return {std::move(read.tensors), json.at("numbers")};
}

void CheckpointFolder::clean_up(std::int64_t newest) const {
  const std::vector<std::string> names = files_in(folder_);
  const std::vector<std::int64_t> stated = stated_steps();
  std::set<std::int64_t> kept{newest};
  for (auto step = stated.rbegin(); step != stated.rend() && kept.size() < kKeepNewest; ++step) {
    if (*step < newest) kept.insert(*step);
  }
  for (const std::int64_t step : stated) {
    if (step % kKeepEvery == 0 || step == kept_) kept.insert(step);
  }
  std::error_code ignored;
  // States first: a set must not look valid while it is being deleted.
  for (const bool states : {true, false}) {
    for (const std::string& name : names) {
      const std::optional<std::int64_t> step = step_of(name);
      const bool old = step && kept.count(*step) == 0 && *step <= newest;
      if (is_state(name) == states && (old || temporary(name))) fs::remove(folder_ / name, ignored);
    }
  }
}

std::optional<fs::path> set_later_steps_aside(const fs::path& run, std::int64_t last) {
  const RunFolder from{run};
  const fs::path checkpoints = from.checkpoints(), samples = from.samples(), metrics = from.metrics();
  std::vector<std::string> files, pictures;
  std::set<std::int64_t> first_of_sets, first_of_rest;
  for (const std::string& name : files_in(checkpoints)) {
    if (step_of(name).value_or(last) <= last) continue;
    files.push_back(name);
    first_of_sets.insert(*step_of(name));
  }
  for (const std::string& name : files_in(samples)) {
    if (step_of_samples(name).value_or(last) <= last) continue;
    pictures.push_back(name);
    first_of_rest.insert(*step_of_samples(name));
  }
  const CsvTable rows = metrics_after(metrics, last);
  for (const auto& row : rows.rows) first_of_rest.insert(std::atoll(row[0].c_str()));
  if (first_of_sets.empty() && first_of_rest.empty()) return std::nullopt;

  const fs::path folder =
      new_abandoned_folder(checkpoints, *(first_of_sets.empty() ? first_of_rest : first_of_sets).begin());
  // The rows are in two places for a moment rather than in none.
  if (!rows.rows.empty()) {
    write_file_atomically(RunFolder{folder}.metrics(), to_csv(rows));
    MetricsLog(metrics, last);
  }
  // States last: a move that is interrupted leaves no weights without one, which a clean-up would delete.
  std::stable_partition(files.begin(), files.end(), [](const std::string& name) { return !is_state(name); });
  for (const std::string& name : files) move_into_folder(checkpoints / name, folder);
  for (const std::string& name : pictures) move_into_folder(samples / name, RunFolder{folder}.samples());
  return folder;
}

fs::path checkpoint_files_of(const fs::path& run) {
  const RunFolder folder{run};
  return !folder.has_checkpoints() && CheckpointFolder(run).holds_states() ? run : folder.checkpoints();
}

std::string generator_state() {
  const torch::Tensor state = at::detail::getDefaultCPUGenerator().get_state();
  return {static_cast<const char*>(state.data_ptr()), static_cast<std::size_t>(state.nbytes())};
}

void check_start(const RunOptions& run) {
  const bool step =
      !run.ckpt.empty() && run.ckpt.size() <= 15 && run.ckpt.find_first_not_of("0123456789") == std::string::npos;
  if (!step && run.ckpt != "none" && run.ckpt != "latest")
    throw InputError("--ckpt", run.ckpt, "expected latest, none or a step");
  if (run.ckpt == "none" && !run.load.empty())
    throw InputError("--load", run.load.string(), "--ckpt none reads no checkpoint; leave one of the two out");
  if (run.restart && run.ckpt == "latest" && run.load.empty())
    throw InputError("--restart", "", "needs --ckpt none, --ckpt STEP or --load DIR, which say where to begin");
}

void Trainer::check_finetuned_models() const {
  std::map<std::string, std::string> unknown = options_.finetune_ckpt;
  for (const nn::NamedModel& model : stages_.front()->models()) unknown.erase(model.name);
  if (unknown.empty()) return;
  throw InputError("", "trainer/args/finetune_ckpt/" + unknown.begin()->first, "there is no model of that name");
}

void Trainer::start_from_files() {
  LoadedKeys finetuned;
  const bool exported = loads_weights_alone(run_);
  if (exported && first())
    log::info("{} holds weights alone: the models start from them, steps and optimiser anew", run_.load.string());
  for (const nn::NamedModel& model : stages_.front()->models()) {
    const auto file = options_.finetune_ckpt.find(model.name);
    std::string name = file == options_.finetune_ckpt.end() ? "" : file->second;
    if (name.empty() && exported) name = nn::newest_checkpoint(run_.load, model.name).string();
    if (name.empty()) continue;
    finetuned[model.name] = load_matching(*model.module, io::read_state_dict(name), name);
  }
  stages_.front()->warm_start(finetuned);
}

// The output's newest checkpoint goes before --load and --ckpt, so that whatever started the command again, a person, a
// launcher or a cluster, the run comes to its end.
Trainer::StartPoint Trainer::choose_start() const {
  const std::optional<std::int64_t> newest = checkpoints_.latest();
  const bool under_way = run_.restart && restart_is_under_way();
  StartPoint start;
  if (newest && (!run_.restart || under_way)) {
    const std::string told = told_start(run_);
    if (under_way) {
      log::warn("--restart has begun before by this command: the run goes on from step {} of {}", *newest,
                run_.output.string());
    } else if (!told.empty() && told != "--ckpt " + std::to_string(*newest)) {
      log::warn(
          "{} is ignored: {} has checkpoints, and the run goes on from the newest of them, step {}; with --restart it "
          "begins again as the option says, and later steps are moved aside",
          told, run_.output.string(), *newest);
    }
    start.step = newest;
    return start;
  }
  start.own = !loads_another_run(run_);
  start.step = step_to_load(start.own ? checkpoints_ : CheckpointFolder(checkpoint_files_of(run_.load)), run_);
  const bool goes_on = start.own && start.step;
  start.begins_again = run_.restart ? !under_way : !goes_on && checkpoints_.holds_states();
  return start;
}

bool Trainer::restart_is_under_way() const {
  const std::filesystem::path file = RunFolder{run_.output}.restart();
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return false;
  const Json begun = read_json(file);
  return begun.is_object() && begun.contains("command") && begun["command"] == run_.command;
}

void Trainer::begin_again() {
  const std::int64_t last = last_kept_step();
  if (const std::optional<std::filesystem::path> folder = set_later_steps_aside(run_.output, last)) {
    if (!run_.earlier_config.empty()) write_file_atomically(RunFolder{*folder}.config(), run_.earlier_config);
    log::warn("what {} held {} is now in {}; nothing of it is deleted, and another run can --load that folder",
              run_.output.string(), last < 0 ? "of earlier runs" : "of the steps after " + std::to_string(last),
              folder->string());
  }
  // Not before: a command that is stopped above begins again.
  if (run_.restart) {
    write_file_atomically(RunFolder{run_.output}.restart(),
                          Json{{"command", run_.command}, {"last_step", last}}.dump(1) + "\n");
  }
  start_.begins_again = false;
}

void Trainer::end_restart() const {
  if (first()) remove_lastingly(RunFolder{run_.output}.restart());
}

// A message that says "saved" or "finished" follows.
void Trainer::require_saved() const {
  if (!first() || checkpoints_.complete(step_)) return;
  throw Error(checkpoints_.file("state", step_).string() + ": the checkpoint of step " + std::to_string(step_) +
              " was written and is not whole any more; does another program work in this folder?");
}

void Trainer::restore(const CheckpointFolder& source, std::int64_t step) {
  for (const nn::NamedModel& model : stages_.front()->models()) {
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
  saved_step_ = start_.own ? step_ : -1;
  log::info("resumed from step {} ({} samples seen)", step_, samples_);
}

// Rank 0 decides from which step, since it may see a folder that another machine does not see yet.
Trainer::StartPoint Trainer::agreed_on(const StartPoint& start_of_rank_0) {
  const std::string step = start_of_rank_0.step ? std::to_string(*start_of_rank_0.step) : "";
  const std::string said = ranks_->gather((start_of_rank_0.own ? "o" : "l") + step).front();
  StartPoint start = start_of_rank_0;
  start.own = said.front() == 'o';
  start.step = said.size() > 1 ? std::optional<std::int64_t>(std::stoll(said.substr(1))) : std::nullopt;
  return start;
}

// Sums move to rank 0, which logs and saves them.
void Trainer::bring_means_together() {
  if (alone()) return;
  Json own = Json::array();
  for (const RunningMeans::Entry& entry : means_.entries) own.push_back({entry.name, entry.sum, entry.count});
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
  if (first()) {
    write_checkpoint(generators);
    if (stream_) stream_->mark_used(stages_.front()->data().generation->number);
    write_page();
  }
  saved_step_ = step_;
}

// Weights and moments are those of the last step that all ranks completed: an update follows only after every exchange
// of its step. What other ranks had to add to the logged means is lost.
void Trainer::save_what_is_complete() noexcept {
  if (!first() || saved_step_ == step_) return;
  try {
    // If a stage draws from LibTorch's generator, the checkpoint would need the other ranks' states, too.
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
  for (const nn::NamedModel& model : stages_.front()->models()) {
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
  saved.arrays.emplace_back("optimizer.exp_avg", nn::to_array(update_->optimizer.exp_avg));
  saved.arrays.emplace_back("optimizer.exp_avg_sq", nn::to_array(update_->optimizer.exp_avg_sq));
  if (update_->muon) saved.arrays.emplace_back("optimizer.momentum", nn::to_array(update_->muon->momentum));
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
  if (stream_) saved.numbers["stream"] = named_shards();
  if (update_->clipper) {
    const AdaptiveGradClipper::State& clip = update_->clipper->state();
    saved.arrays.emplace_back("grad_clip.buffer",
                              io::NdArray::from(clip.buffer, {static_cast<std::int64_t>(clip.buffer.size())}));
    saved.numbers["grad_clip"] = {{"threshold", clip.threshold}, {"pointer", clip.pointer}, {"length", clip.length}};
  }
  if (update_->recovery.belongs_to_state(step_)) {
    saved.arrays.emplace_back("recovery.master", nn::to_array(update_->recovery.master()));
    saved.numbers["recovery_step"] = update_->recovery.step();
  }
  Json means = Json::array();
  for (const RunningMeans::Entry& entry : means_.entries) means.push_back({entry.name, entry.sum, entry.count});
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
    return nn::to_tensor(*array);
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
    // Another run's hours are not those of this one, nor are the losses since its last row.
    elapsed_before_ = start_.own ? numbers.at("elapsed_s").get<double>() : 0.0;
    saved_shards_ = numbers.value("stream", Json());
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
    for (const Json& entry : first() && start_.own ? numbers.at("running_means") : none) {
      means_.entries.push_back(
          {entry.at(0).get<std::string>(), entry.at(1).get<double>(), entry.at(2).get<std::int64_t>()});
    }
  } catch (const nlohmann::json::exception& error) {
    throw InputError("", "state", std::string("the saved state is damaged: ") + error.what());
  }
}

}  // namespace anigen::train
