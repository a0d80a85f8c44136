#include "anigen/experiment/plan.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/core/version.h"
#include "anigen/experiment/run_jobs.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;

constexpr int kMost = 1 << 16;

/// True when several processes of a program, called alike, divide the work.
bool shares_its_work(const std::string& program, const std::string& word, const Json& arguments) {
  if (program == "anigen-encode") return word != "reconstruct" && word != "grouping";
  if (program == "anigen-eval") return arguments.contains("--pred");
  return program == "anigen-prepare" || program == "anigen-generate";
}

/// As sbatch takes it, to the next minute.
std::string time_text(double hours) {
  const long minutes = std::max(1L, static_cast<long>(std::ceil(hours * 60)));
  char text[32];
  std::snprintf(text, sizeof text, "%ld:%02ld:00", minutes / 60, minutes % 60);
  return text;
}

/// `"resources"` of a step. @param word that stands first on its command line
/// @throws InputError for numbers out of range, or several workers of a program that cannot share its work
Resources read_resources(ConfigReader& step, const std::string& program, const std::string& word,
                         const Json& arguments) {
  Resources resources;
  if (!step.has("resources")) return resources;
  ConfigReader reader = step.object("resources");
  ConfigFields f(reader);
  f("workers", resources.workers, {1, kMost});
  f("cpus", resources.cpus, {0, kMost});
  f("gpus", resources.gpus, {0, kMost});
  f("memory_gb", resources.memory_gb, {0.0});
  f("hours", resources.hours, {0.0});
  f("partition", resources.partition);
  if (resources.partition.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-.,") !=
      std::string::npos)
    throw reader.error("partition", "names of partitions are made of letters, digits, '_', '-' and '.'");
  if (resources.workers > 1 && !shares_its_work(program, word, arguments))
    throw reader.error("workers", program + (word.empty() ? "" : " " + word) + " does not share this work");
  reader.finish();
  return resources;
}

const std::vector<std::string>& programs() {
  static const std::vector<std::string> names{"anigen-prepare", "anigen-train", "anigen-encode", "anigen-generate",
                                              "anigen-rig",     "anigen-eval",  "anigen-animate"};
  return names;
}

std::string default_output(const std::string& program) { return program == "anigen-encode" ? "" : "--output"; }

/// Nested objects become dotted paths, and of two that mean the same the later one counts; null takes an earlier one
/// back.
void flatten(const Json& object, const std::string& path, Json& settings) {
  for (const auto& [key, value] : object.items()) {
    const std::string name = path.empty() ? key : path + "." + key;
    if (value.is_object() && !value.empty()) {
      flatten(value, name, settings);
    } else if (value.is_null()) {
      settings.erase(name);
    } else {
      settings[name] = value;
    }
  }
}

bool scalar(const Json& value) { return value.is_string() || value.is_number() || value.is_boolean(); }

/// @param seeded the experiment gives this step its seeds
void require_arguments(const Step& step, const ConfigReader& reader, bool seeded) {
  for (const auto& [option, value] : step.arguments.items()) {
    const std::string key = "args/" + escaped_for_pointer(option);
    if (option.rfind("--", 0) != 0 || option.size() < 3) throw reader.error(key, "options begin with --");
    if (option == step.output || option == "--threads" || (seeded && option == "--seed"))
      throw reader.error(key, "is set by the experiment itself");
    const bool list = value.is_array() && std::all_of(value.begin(), value.end(), scalar);
    if (!list && !scalar(value) && !value.is_null())
      throw reader.error(key, "expected a text, a number, true, false, or a list of these");
  }
}

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

bool is_given(const Json& arguments, const char* option) {
  return arguments.contains(option) && !arguments[option].is_null() && arguments[option] != false;
}

/// True if inputs may fail, which the step's own "--keep-going": false forbids: they are in the tables of results.
bool keeps_going(const std::string& program, const Json& arguments) {
  if (arguments.contains("--keep-going") || program == "anigen-train") return false;
  if (program != "anigen-eval") return true;
  if (is_given(arguments, "--matting-network")) return false;
  return !is_given(arguments, "--ss-flow") || is_given(arguments, "--oracle");
}

/// True if a program computes on --device with these arguments; otherwise it refuses the option.
bool uses_device(const std::string& program, const Json& arguments) {
  const auto given = [&](const char* option) { return is_given(arguments, option); };
  if (program == "anigen-prepare") return given("--features") && arguments["--features"] != "surface";
  if (program == "anigen-rig" && given("--retrieval-encoder")) return true;
  if (program == "anigen-rig") {
    const Json method = given("--method") ? arguments["--method"] : Json();
    return method == "anymate" || method == "rignet" || method == "anigen";
  }
  if (program == "anigen-eval") {
    return given("--ss-flow") || given("--skin-ae") || given("--lpips-weights") || given("--image-encoder");
  }
  return program != "anigen-inspect" && program != "anigen-animate";
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
    label_ = run_label(experiment, run);
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

  fs::path file_of(const std::string& inside) const { return experiment_.folder / inside.substr(sizeof kPath - 1); }

  const Job& job_of(const std::string& step) const { return plan_.jobs[run_.jobs.at(step)]; }

  /// Inputs that decide the result: the command, with keys and contents where that has paths.
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
    if (keeps_going(step.program, texts.arguments)) command.emplace_back("--keep-going");
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

std::string filled_in(const std::string& text, const Meaning& meaning) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '{') {
      result += text[i];
    } else if (text.compare(i, 2, "{{") == 0) {
      result += text[i++];
    } else {
      const std::size_t end = text.find('}', i);
      if (end == std::string::npos) throw InputError("", "", "'" + text + "': '{' without '}'; a brace itself is '{{'");
      result += meaning(text.substr(i + 1, end - i - 1));
      i = end;
    }
  }
  return result;
}

Json filled_in(const Json& value, const Meaning& meaning) {
  if (value.is_string()) return filled_in(value.get_ref<const std::string&>(), meaning);
  if (!value.is_structured()) return value;
  Json result = value.is_array() ? Json::array() : Json::object();
  if (value.is_array()) {
    for (const Json& item : value) result.push_back(filled_in(item, meaning));
  } else {
    for (const auto& [key, item] : value.items()) result[key] = filled_in(item, meaning);
  }
  return result;
}

std::string sbatch_lines(const Resources& resources) {
  std::string lines;
  const auto add = [&](const std::string& option, const std::string& value) {
    lines += "#SBATCH --" + option + "=" + value + "\n";
  };
  if (!resources.partition.empty()) add("partition", resources.partition);
  if (resources.cpus > 0) add("cpus-per-task", std::to_string(resources.cpus));
  if (resources.gpus > 0) add("gpus-per-node", std::to_string(resources.gpus));
  if (resources.memory_gb > 0)
    add("mem", std::to_string(static_cast<long>(std::ceil(resources.memory_gb * 1024))) + "M");
  if (resources.hours > 0) add("time", time_text(resources.hours));
  return lines;
}

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
    if (!from.contains("set")) return;
    if (from.at("set").is_null()) settings = Json::object();
    if (from.at("set").is_object()) flatten(from.at("set"), "", settings);
    if (from.at("set").is_null() || from.at("set").is_object()) from.erase("set");
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
  if (trains) step.config = experiment.folder / reader.text("config", "");
  reader.object("set");  // what is left of it is no object, and refused
  if (!trains && !settings.empty()) throw reader.error("set", "only anigen-train takes settings");
  step.settings = settings;
  step.after = reader.texts("after", {});
  for (const std::string& other : step.after) require_step(experiment.steps, reader, "after", other);
  step.minutes = reader.number("minutes", 0, 0);
  step.megabytes = reader.number("megabytes", 0, 0);
  step.resources = read_resources(reader, step.program, step.words.empty() ? "" : step.words.front(), step.arguments);
  const std::vector<std::string>& seeded = experiment.seeded;
  require_arguments(step, reader, std::find(seeded.begin(), seeded.end(), name) != seeded.end());
  reader.finish();
  return step;
}

std::string run_label(const Experiment& experiment, const PlannedRun& run) {
  std::string label = experiment.variants[run.variant].name;
  if (experiment.seeds.size() > 1) label += (label.empty() ? "" : ", ") + ("seed " + std::to_string(run.seed));
  return label;
}

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
