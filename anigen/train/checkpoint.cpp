#include "anigen/train/checkpoint.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <set>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/io/safetensors.h"
#include "anigen/train/metrics_log.h"

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
  std::error_code error;
  fs::create_directories(checkpoints, error);
  for (int number = 1; !error; ++number) {
    const fs::path folder = checkpoints / ("abandoned-" + std::to_string(first) + "-" + std::to_string(number));
    if (fs::create_directory(folder, error)) return folder;
  }
  throw Error(checkpoints.string() + ": cannot create a folder: " + error.message());
}

void move_into(const fs::path& folder, const fs::path& entry) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (!error) fs::rename(entry, folder / entry.filename(), error);
  if (error) throw Error(entry.string() + ": cannot be moved to " + folder.string() + ": " + error.message());
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
  std::error_code ignored;
  fs::remove(file(kState, step), ignored);
  Json sizes = Json::object();
  for (const auto& [name, arrays] : weights) {
    const fs::path path = file(name, step);
    io::write_safetensors(path, arrays);
    sizes[path.filename().string()] = fs::file_size(path);
  }
  const Json entry{{"step", step}, {"files", sizes}, {"numbers", state.numbers}};
  io::write_safetensors(file(kState, step), state.arrays, {{"state", entry.dump()}});
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

bool CheckpointFolder::holds_states() const { return !stated_steps().empty(); }

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
    if (step % kKeepEvery == 0) kept.insert(step);
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
  const fs::path checkpoints = run / "ckpts", samples = run / "samples", metrics = run / "metrics.csv";
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
    write_file_atomically(folder / "metrics.csv", to_csv(rows));
    MetricsLog(metrics, last);
  }
  // States last: a move that is interrupted leaves no weights without one, which a clean-up would delete.
  std::stable_partition(files.begin(), files.end(), [](const std::string& name) { return !is_state(name); });
  for (const std::string& name : files) move_into(folder, checkpoints / name);
  for (const std::string& name : pictures) move_into(folder / "samples", samples / name);
  return folder;
}

fs::path checkpoint_files_of(const fs::path& run) {
  std::error_code error;
  const bool direct = !fs::is_directory(run / "ckpts", error) && CheckpointFolder(run).holds_states();
  return direct ? run : run / "ckpts";
}

}  // namespace anigen::train
