#include "anigen/experiment/plan.h"

#include <algorithm>
#include <functional>

#include "anigen/core/config_file.h"
#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/core/sha256.h"
#include "anigen/core/version.h"
#include "anigen/experiment/input_fingerprint.h"
#include "anigen/experiment/placeholders.h"
#include "anigen/experiment/step.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kKeyDigits = 10;  // of a folder's name: 40 bits, for at most thousands of jobs
constexpr const char kPath[] = "path:", kName[] = ".name";

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() > end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

/// The step that a placeholder speaks of; empty for those that speak of no step.
std::string step_in(const std::string& inside) {
  if (inside == "seed" || inside.rfind(kPath, 0) == 0) return "";
  return ends_with(inside, kName) ? inside.substr(0, inside.size() - (sizeof kName - 1)) : inside;
}

/// JSON text that does not depend on the order of keys.
std::string canonical(const Json& json) { return nlohmann::json::parse(json.dump()).dump(); }

std::string option_text(const Json& value) { return value.is_string() ? value.get<std::string>() : value.dump(); }

/// A value as --set reads it back: text that is JSON too needs its quotes.
std::string setting_text(const Json& value) {
  if (!value.is_string() || Json::accept(value.get<std::string>())) return value.dump();
  return value.get<std::string>();
}

void append_option(std::vector<std::string>& command, const std::string& option, const Json& value) {
  if (value.is_null() || (value.is_boolean() && !value.get<bool>())) return;
  if (value.is_array()) {
    for (const Json& item : value) append_option(command, option, item);
    return;
  }
  command.push_back(option);
  if (!value.is_boolean()) command.push_back(option_text(value));
}

/// True if a program computes on --device with these arguments; otherwise it refuses the option.
bool uses_device(const std::string& program, const Json& arguments) {
  const auto given = [&](const char* option) {
    return arguments.contains(option) && !arguments[option].is_null() && arguments[option] != false;
  };
  if (program == "anigen-prepare") return given("--features") && arguments["--features"] != "surface";
  if (program == "anigen-rig")
    return given("--method") && (arguments["--method"] == "anymate" || arguments["--method"] == "rignet");
  if (program == "anigen-eval") return given("--ss-flow") || given("--skin-ae") || given("--lpips-weights");
  return program != "anigen-inspect";
}

/// One variant with one seed, step by step.
class RunPlanner {
 public:
  RunPlanner(const Experiment& experiment, const Workplace& place, const PlannedRun& run, Plan& plan,
             std::map<std::string, std::size_t>& by_key)
      : experiment_(experiment), place_(place), run_(run), plan_(plan), by_key_(by_key) {
    const Variant& variant = experiment.variants[run.variant];
    for (const auto& [name, unused] : experiment.steps.items())
      steps_.emplace(name, read_step(experiment, variant, name));
    label_ = variant.name;
    if (experiment.seeds.size() > 1) label_ += (label_.empty() ? "" : ", ") + ("seed " + std::to_string(run.seed));
  }

  PlannedRun make() {
    for (const std::string& name : experiment_.goals) plan_step(name, {});
    return run_;
  }

 private:
  /// @param waiting steps that wait for this one, outermost first
  std::size_t plan_step(const std::string& name, std::vector<std::string> waiting) {
    const auto done = run_.jobs.find(name);
    if (done != run_.jobs.end()) return done->second;
    if (std::find(waiting.begin(), waiting.end(), name) != waiting.end()) {
      std::string circle;
      for (const std::string& step : waiting) circle += step + " → ";
      throw error(name, "steps wait for each other: " + circle + name);
    }
    waiting.push_back(name);
    const Step& step = steps_.at(name);
    std::vector<std::size_t> needs;
    for (const std::string& other : needed_by(step)) needs.push_back(plan_step(other, waiting));
    return run_.jobs[name] = place_job(step, needs);
  }

  /// Steps that this one needs, in the order of the file's texts, each once.
  std::vector<std::string> needed_by(const Step& step) const {
    std::vector<std::string> names = step.after;
    if (!step.writes_into.empty()) names.push_back(step.writes_into);
    const Meaning collect = [&](const std::string& inside) {
      const std::string other = step_in(inside);
      if (!other.empty()) {
        if (steps_.count(other) == 0) throw unknown(step.name, inside);
        names.push_back(other);
      }
      return std::string();
    };
    filled(step, collect);
    std::vector<std::string> once;
    for (const std::string& name : names)
      if (std::find(once.begin(), once.end(), name) == once.end()) once.push_back(name);
    return once;
  }

  struct Texts {
    Json words, arguments, settings;
  };
  Texts filled(const Step& step, const Meaning& meaning) const {
    try {
      return {filled_in(Json(step.words), meaning), filled_in(step.arguments, meaning),
              filled_in(step.settings, meaning)};
    } catch (const InputError& problem) {
      if (!problem.file().empty()) throw;
      throw error(step.name, problem.problem());
    }
  }

  bool seeded(const std::string& name) const {
    return std::find(experiment_.seeded.begin(), experiment_.seeded.end(), name) != experiment_.seeded.end();
  }

  fs::path file_of(const std::string& inside) const {
    return fs::absolute(experiment_.file).parent_path() / inside.substr(sizeof kPath - 1);
  }

  const Job& job_of(const std::string& step) const { return plan_.jobs[run_.jobs.at(step)]; }

  /// What decides the result: as the command, with keys and contents where that has paths.
  Json description(const Step& step, const std::vector<std::size_t>& needs, bool code) const {
    const Meaning meaning = [&](const std::string& inside) -> std::string {
      if (inside == "seed") return std::to_string(run_.seed);
      if (inside.rfind(kPath, 0) == 0) return input_fingerprint(file_of(inside));
      const Job& other = job_of(step_in(inside));
      return inside + "=" + (code ? other.key : other.content);
    };
    const Texts texts = filled(step, meaning);
    Json json{{"step", step.name}, {"program", step.program}, {"words", texts.words}, {"arguments", texts.arguments}};
    if (!step.config.empty()) {
      json["config"] = load_config(step.config);
      for (const auto& [path, value] : texts.settings.items())
        apply_override(json["config"], path + "=" + setting_text(value));
    }
    if (seeded(step.name)) json["seed"] = run_.seed;
    Json keys = Json::array();
    for (const std::size_t need : needs) keys.push_back(code ? plan_.jobs[need].key : plan_.jobs[need].content);
    std::sort(keys.begin(), keys.end());
    json["needs"] = keys;
    json["version"] = kVersion;
    json["device"] = place_.device;
    json["writes_into"] = step.writes_into;
    if (code) json["code"] = program_fingerprint(place_.programs / step.program);
    return json;
  }

  std::size_t place_job(const Step& step, const std::vector<std::size_t>& needs) {
    const std::string key = sha256(canonical(description(step, needs, true)));
    const auto [found, is_new] = by_key_.emplace(key, plan_.jobs.size());
    if (is_new) {
      Job job;
      job.id = step.name + "-" + key.substr(0, kKeyDigits);
      job.key = key;
      job.content = sha256(canonical(description(step, needs, false)));
      job.step = step.name;
      job.program = step.program;
      job.needs = needs;
      job.minutes = step.minutes;
      job.megabytes = step.megabytes;
      job.resources = step.resources;
      job.writes_into_other = !step.writes_into.empty();
      job.folder = job.writes_into_other ? job_of(step.writes_into).folder : place_.out / "jobs" / job.id;
      job.command = command(step, job.folder);
      job.program_state = input_fingerprint(place_.programs / step.program);
      plan_.jobs.push_back(std::move(job));
    }
    Job& job = plan_.jobs[found->second];
    if (std::find(job.serves.begin(), job.serves.end(), label_) == job.serves.end()) job.serves.push_back(label_);
    return found->second;
  }

  std::vector<std::string> command(const Step& step, const fs::path& folder) const {
    const Meaning meaning = [&](const std::string& inside) -> std::string {
      if (inside == "seed") return std::to_string(run_.seed);
      if (inside.rfind(kPath, 0) == 0) return file_of(inside).lexically_normal().string();
      const Job& other = job_of(step_in(inside));
      return ends_with(inside, kName) ? other.folder.filename().string() : other.folder.string();
    };
    const Texts texts = filled(step, meaning);
    std::vector<std::string> command{(place_.programs / step.program).string()};
    for (const Json& word : texts.words) command.push_back(word.get<std::string>());
    if (!step.config.empty()) append_option(command, "--config", step.config.lexically_normal().string());
    if (!step.output.empty()) append_option(command, step.output, folder.string());
    for (const auto& [option, value] : texts.arguments.items()) append_option(command, option, value);
    for (const auto& [path, value] : texts.settings.items())
      append_option(command, "--set", path + "=" + setting_text(value));
    if (seeded(step.name)) append_option(command, "--seed", run_.seed);
    if (place_.device != "cpu" && uses_device(step.program, texts.arguments))
      append_option(command, "--device", place_.device);
    return command;
  }

  InputError error(const std::string& step, const std::string& problem) const {
    return InputError(experiment_.file.string(), "/steps/" + step, problem);
  }
  InputError unknown(const std::string& step, const std::string& inside) const {
    std::vector<std::string> known{"seed"};
    for (const auto& [name, unused] : steps_) known.push_back(name);
    const std::string nearest = nearest_word(step_in(inside), known);
    return error(step,
                 "'{" + inside + "}' names no step" + (nearest.empty() ? "" : "; did you mean '{" + nearest + "}'?"));
  }

  const Experiment& experiment_;
  const Workplace& place_;
  PlannedRun run_;
  Plan& plan_;
  std::map<std::string, std::size_t>& by_key_;
  std::map<std::string, Step> steps_;
  std::string label_;
};

}  // namespace

Plan make_plan(const Experiment& experiment, const Workplace& place) {
  Plan plan;
  std::map<std::string, std::size_t> by_key;
  for (std::size_t variant = 0; variant < experiment.variants.size(); ++variant) {
    for (const std::uint64_t seed : experiment.seeds)
      plan.runs.push_back(RunPlanner(experiment, place, {variant, seed, {}}, plan, by_key).make());
  }
  return plan;
}

bool is_job_id(const std::string& name) {
  const std::size_t dash = name.rfind('-');
  return dash != std::string::npos && dash > 0 && name.size() - dash - 1 == kKeyDigits &&
         name.find_first_not_of("0123456789abcdef", dash + 1) == std::string::npos;
}

std::string shell_line(const std::vector<std::string>& command) {
  std::string line;
  for (const std::string& word : command) {
    const bool plain = !word.empty() && word.find_first_not_of(
                                            "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                            "0123456789_-+=./:,@%") == std::string::npos;
    std::string quoted = "'";
    for (const char c : word) quoted += c == '\'' ? "'\\''" : std::string(1, c);
    line += (line.empty() ? "" : " ") + (plain ? word : quoted + "'");
  }
  return line;
}

}  // namespace anigen::experiment
