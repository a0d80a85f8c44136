#include "anigen/train/checkpoint.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/io/safetensors.h"

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

bool temporary(const std::string& file) { return file.find(".tmp-") != std::string::npos; }

std::vector<std::string> files_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
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
}

bool CheckpointFolder::complete(std::int64_t step) const {
  std::error_code error;
  if (!fs::exists(file(kState, step), error)) return false;
  try {
    const auto metadata = io::read_safetensors(file(kState, step)).metadata;
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

std::vector<std::int64_t> CheckpointFolder::steps() const {
  std::vector<std::int64_t> found;
  for (const std::string& name : files_in(folder_)) {
    const std::optional<std::int64_t> step = step_of(name);
    if (step && name.rfind(std::string(kState) + "_step", 0) == 0) found.push_back(*step);
  }
  std::sort(found.begin(), found.end());
  found.erase(std::remove_if(found.begin(), found.end(), [this](std::int64_t step) { return !complete(step); }),
              found.end());
  return found;
}

std::optional<std::int64_t> CheckpointFolder::latest() const {
  const std::vector<std::int64_t> all = steps();
  return all.empty() ? std::nullopt : std::optional<std::int64_t>(all.back());
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
  std::set<std::int64_t> stated;
  for (const std::string& name : names) {
    if (name.rfind(std::string(kState) + "_step", 0) == 0 && step_of(name)) stated.insert(*step_of(name));
  }
  std::set<std::int64_t> kept;
  for (auto step = stated.rbegin(); step != stated.rend() && kept.size() < kKeepNewest; ++step) kept.insert(*step);
  for (const std::int64_t step : stated) {
    if (step % kKeepEvery == 0) kept.insert(step);
  }
  std::error_code ignored;
  // States first: a set must not look valid while it is being deleted.
  for (const bool states : {true, false}) {
    for (const std::string& name : names) {
      const std::optional<std::int64_t> step = step_of(name);
      const bool is_state = name.rfind(std::string(kState) + "_step", 0) == 0;
      const bool old = step && kept.count(*step) == 0 && *step <= newest;
      if (is_state == states && (old || temporary(name))) fs::remove(folder_ / name, ignored);
    }
  }
}

}  // namespace anigen::train
