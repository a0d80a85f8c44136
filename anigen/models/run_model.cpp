#include "anigen/models/run_model.h"

#include <algorithm>
#include <cstdint>
#include <set>
#include <system_error>
#include <tuple>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/checkpoint_folder.h"

namespace anigen::models {
namespace {

namespace fs = std::filesystem;

// Written last by our trainer, and by the published one.
bool is_state(const std::string& name) { return name.rfind("state_step", 0) == 0 || name.rfind("misc_step", 0) == 0; }

bool is_averaged(const std::string& name, const std::string& model) {
  return name.compare(model.size(), 4, "_ema") == 0;
}

fs::path named_or_newest(const fs::path& run, const std::string& model, const std::string& ckpt) {
  if (ckpt.empty()) return newest_checkpoint(run, model);
  try {
    return io::choose_checkpoint(run, model, ckpt);
  } catch (const InputError&) {
    if (ckpt != "final") throw;
    return newest_checkpoint(run, model);
  }
}

}  // namespace

fs::path newest_checkpoint(const fs::path& folder, const std::string& model, bool averaged) {
  std::error_code error;
  const fs::path files = fs::is_directory(folder / "ckpts", error) ? folder / "ckpts" : folder;
  std::vector<std::string> names;
  std::set<std::int64_t> complete;
  for (const std::string& name : io::checkpoint_names(files)) {
    if (is_state(name)) complete.insert(io::step_of(name));
    if (name.rfind(model + "_", 0) == 0) names.push_back(name);
  }
  if (names.empty()) throw InputError(files.string(), "", "holds no weights of the model '" + model + "'");
  const auto rank = [&](const std::string& name) {
    const std::int64_t step = io::step_of(name);
    return std::make_tuple(complete.count(step) > 0, step, is_averaged(name, model) == averaged);
  };
  // Of several averages the first by name, which is how they are listed.
  return files / *std::max_element(names.begin(), names.end(),
                                   [&](const std::string& a, const std::string& b) { return rank(a) < rank(b); });
}

namespace {

/// The model of one of these classes in a run, without its weights.
RunModel described_model(const fs::path& run, const std::vector<std::string>& class_names) {
  std::error_code error;
  if (!fs::is_directory(run, error)) throw InputError(run.string(), "", "no such run folder");
  RunModel found;
  found.config = run / "config.json";
  found.run = read_json(found.config);
  if (found.run.is_object() && found.run.contains("models") && found.run["models"].is_object()) {
    for (const auto& [key, model] : found.run["models"].items()) {
      if (!model.is_object() || !model.contains("name")) continue;
      if (std::find(class_names.begin(), class_names.end(), model["name"]) == class_names.end()) continue;
      found.name = key;
      found.args = model.contains("args") ? model["args"] : Json::object();
      found.pointer = "/models/" + escaped_for_pointer(key) + "/args";
      return found;
    }
  }
  throw InputError(found.config.string(), "/models", "describes no model named " + class_names.front());
}

}  // namespace

bool has_training_state(const fs::path& run) {
  std::error_code error;
  const fs::path files = fs::is_directory(run / "ckpts", error) ? run / "ckpts" : run;
  const std::vector<std::string> names = io::checkpoint_names(files);
  return std::any_of(names.begin(), names.end(), is_state);
}

RunModel find_run_model(const fs::path& run, const std::string& class_name, const std::string& ckpt) {
  RunModel found = described_model(run, {class_name});
  found.checkpoint = named_or_newest(run, found.name, ckpt);
  return found;
}

RunModel find_flow_model(const fs::path& run, const std::vector<std::string>& class_names, const std::string& ckpt,
                         Averages averages) {
  RunModel found = described_model(run, class_names);
  if (!ckpt.empty()) {
    found.checkpoint = io::choose_checkpoint(run, found.name, ckpt);
  } else if (has_training_state(run)) {
    found.checkpoint = newest_checkpoint(run, found.name, averages != Averages::kNever);
  } else {
    found.checkpoint = io::choose_flow_checkpoint(run, averages == Averages::kAlways);
  }
  return found;
}

}  // namespace anigen::models
