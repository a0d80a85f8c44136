#include "anigen/experiment/step.h"

#include <algorithm>

#include "anigen/core/config_file.h"
#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string>& programs() {
  static const std::vector<std::string> names{"anigen-prepare",  "anigen-train", "anigen-encode",
                                              "anigen-generate", "anigen-rig",   "anigen-eval"};
  return names;
}

std::string default_output(const std::string& program) {
  if (program == "anigen-train" || program == "anigen-generate") return "--output";
  return program == "anigen-encode" ? "" : "--out";
}

/// Nested objects become dotted paths, and of two that mean the same the later one counts.
void flatten(const Json& object, const std::string& path, Json& settings) {
  for (const auto& [key, value] : object.items()) {
    const std::string name = path.empty() ? key : path + "." + key;
    if (value.is_object() && !value.empty()) {
      flatten(value, name, settings);
    } else {
      settings[name] = value;
    }
  }
}

bool scalar(const Json& value) { return value.is_string() || value.is_number() || value.is_boolean(); }

void require_arguments(const Step& step, const ConfigReader& reader) {
  for (const auto& [option, value] : step.arguments.items()) {
    const std::string key = "args/" + escaped_for_pointer(option);
    if (option.rfind("--", 0) != 0 || option.size() < 3) throw reader.error(key, "options begin with --");
    if (option == step.output || option == "--seed" || option == "--threads")
      throw reader.error(key, "is set by the experiment itself");
    const bool list = value.is_array() && std::all_of(value.begin(), value.end(), scalar);
    if (!list && !scalar(value) && !value.is_null())
      throw reader.error(key, "expected a text, a number, true, false, or a list of these");
  }
}

}  // namespace

void require_step(const Json& steps, const ConfigReader& reader, const std::string& key, const std::string& name) {
  if (steps.contains(name)) return;
  std::vector<std::string> known;
  for (const auto& [step, unused] : steps.items()) known.push_back(step);
  const std::string nearest = nearest_word(name, known);
  throw reader.error(key,
                     "there is no step '" + name + "'" + (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"));
}

Step read_step(const Experiment& experiment, const Variant& variant, const std::string& name) {
  Json json = experiment.steps.at(name), settings = Json::object();
  // Settings are overlaid as paths: the same one may be written nested here and dotted there.
  const auto take_settings = [&settings](Json& from) {
    if (!from.contains("set") || !from.at("set").is_object()) return;
    flatten(from.at("set"), "", settings);
    from.erase("set");
  };
  take_settings(json);
  if (variant.changes.contains(name)) {
    Json changes = variant.changes.at(name);
    take_settings(changes);
    merge_config(json, changes);
  }
  ConfigReader reader(json, experiment.file.string(),
                      "/steps/" + name + (variant.name.empty() ? "" : " (variant " + variant.name + ")"));
  reader.require("program");
  Step step;
  step.name = name;
  step.program = reader.choice("program", "", programs());
  step.words = reader.texts("words", {});
  reader.object("args");
  if (const Json* arguments = reader.raw("args")) step.arguments = *arguments;
  step.writes_into = reader.text("writes_into", "");
  if (!step.writes_into.empty()) require_step(experiment.steps, reader, "writes_into", step.writes_into);
  step.output = reader.text("output", step.writes_into.empty() ? default_output(step.program) : "");
  if (step.output.empty() == step.writes_into.empty())
    throw reader.error("output", "a step has an option for its own folder, or says whose folder it writes_into");
  const bool trains = step.program == "anigen-train";
  if (trains != reader.has("config"))
    throw reader.error("config", trains ? "is missing" : "only anigen-train takes one");
  if (trains) step.config = fs::absolute(experiment.file).parent_path() / reader.text("config", "");
  reader.object("set");  // what is left of it is no object, and refused
  if (!trains && !settings.empty()) throw reader.error("set", "only anigen-train takes settings");
  step.settings = settings;
  step.after = reader.texts("after", {});
  for (const std::string& other : step.after) require_step(experiment.steps, reader, "after", other);
  step.minutes = reader.number("minutes", 0, 0);
  step.megabytes = reader.number("megabytes", 0, 0);
  step.resources = read_resources(reader, step.program, step.words.empty() ? "" : step.words.front(), step.arguments);
  require_arguments(step, reader);
  reader.finish();
  return step;
}

}  // namespace anigen::experiment
