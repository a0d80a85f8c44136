#include "anigen/nn/state_dict.h"

#include <algorithm>
#include <cstdint>
#include <set>
#include <system_error>
#include <tuple>
#include <unordered_map>
#include <unordered_set>

#include "anigen/core/error.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/text.h"
#include "anigen/io/arrays/safetensors.h"

namespace anigen::nn {

bool is_floating_point(io::Dtype dtype) {
  return dtype == io::Dtype::kF16 || dtype == io::Dtype::kBF16 || dtype == io::Dtype::kF32 || dtype == io::Dtype::kF64;
}

void check_weight_values(const io::NamedArrays& arrays, const std::string& file) {
  for (const auto& [key, array] : arrays) {
    if (!is_floating_point(array.dtype))
      throw InputError(file, key, std::string("floating-point weights expected, found ") + io::name_of(array.dtype));
    if (!to_tensor(array).isfinite().all().item<bool>())
      throw InputError(file, key, "holds values that are not finite; fetch the weights again");
  }
}

namespace {

void collect(const torch::nn::Module& module, const std::string& prefix, std::vector<StateEntry>& entries) {
  for (const auto& item : module.named_parameters(/*recurse=*/false)) {
    if (item.value().defined()) entries.push_back({prefix + item.key(), item.value(), false});
  }
  for (const auto& item : module.named_buffers(/*recurse=*/false)) {
    if (item.value().defined()) entries.push_back({prefix + item.key(), item.value(), true});
  }
  for (const auto& child : module.named_children()) collect(*child.value(), prefix + child.key() + ".", entries);
}

void check_strict(const LoadReport& report, const std::string& source) {
  std::string problem;
  constexpr std::size_t kShown = 4;
  if (!report.missing.empty()) problem = "missing " + listed(report.missing, kShown);
  if (!report.unexpected.empty())
    problem += (problem.empty() ? "" : "; ") + ("unexpected " + listed(report.unexpected, kShown));
  if (!problem.empty()) throw InputError(source, "", "these are not the weights of this model: " + problem);
}

void check_shape(const StateEntry& entry, const io::NdArray& array, const std::string& source) {
  if (entry.tensor.sizes() == torch::IntArrayRef(array.shape)) return;
  throw InputError(source, entry.key,
                   "the file has shape " + shape_text(array.shape) + ", the model " + shape_text(entry.tensor.sizes()));
}

bool lies_below(const std::string& key, const std::string& module) {
  return key.size() > module.size() && key.compare(0, module.size(), module) == 0 && key[module.size()] == '.';
}

/// @param done called with each array when it is in the model
template <typename Arrays, typename Done>
LoadReport load_arrays(torch::nn::Module& module, Arrays& arrays, LoadMode mode, const std::string& source,
                       const Done& done) {
  using Array = std::remove_reference_t<decltype((arrays.begin()->second))>;
  std::unordered_map<std::string, Array*> by_key;
  for (auto& [key, array] : arrays) by_key[key] = &array;

  LoadReport report;
  std::unordered_set<std::string> used;
  std::vector<std::pair<Tensor, Array*>> copies;
  for (const StateEntry& entry : state_entries(module)) {
    const auto found = by_key.find(entry.key);
    if (found == by_key.end()) {
      report.missing.push_back(entry.key);
      continue;
    }
    used.insert(entry.key);
    check_shape(entry, *found->second, source);
    torch_dtype(found->second->dtype);  // refuses what a tensor cannot hold before anything is written
    copies.emplace_back(entry.tensor, found->second);
  }
  for (const auto& [key, array] : arrays) {
    if (used.count(key) == 0) report.unexpected.push_back(key);
  }
  if (mode == LoadMode::kStrict) check_strict(report, source);

  const torch::NoGradGuard no_grad;
  for (auto& [tensor, array] : copies) {
    tensor.copy_(to_tensor(*array));
    done(*array);
  }
  return report;
}

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

/// The model of one of these classes in a run, without its weights.
RunModel described_model(const fs::path& run, const std::vector<std::string>& class_names) {
  std::error_code error;
  if (!fs::is_directory(run, error)) throw InputError(run.string(), "", "no such run folder");
  RunModel found;
  found.config = RunFolder{run}.config();
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

std::vector<StateEntry> state_entries(const torch::nn::Module& module) {
  std::vector<StateEntry> entries;
  collect(module, "", entries);
  return entries;
}

io::NamedArrays state_dict(const torch::nn::Module& module) {
  io::NamedArrays arrays;
  for (const StateEntry& entry : state_entries(module)) arrays.emplace_back(entry.key, to_array(entry.tensor));
  return arrays;
}

LoadReport load_state_dict(torch::nn::Module& module, const io::NamedArrays& arrays, LoadMode mode,
                           const std::string& source) {
  return load_arrays(module, arrays, mode, source, [](const io::NdArray&) {});
}

LoadReport load_state_dict(torch::nn::Module& module, io::NamedArrays&& arrays, LoadMode mode,
                           const std::string& source) {
  return load_arrays(module, arrays, mode, source,
                     [](io::NdArray& array) { std::vector<std::uint8_t>().swap(array.bytes); });
}

void load_state_file(torch::nn::Module& module, const fs::path& file, const LoadedKey& loaded) {
  const std::string source = file.string();
  const std::vector<StateEntry> entries = state_entries(module);
  std::unordered_map<std::string, const StateEntry*> by_key;
  for (const StateEntry& entry : entries) by_key[entry.key] = &entry;

  LoadReport report;
  const torch::NoGradGuard no_grad;
  io::visit_state_dict(file, [&](const std::string& key, io::NdArray&& array) {
    const auto found = by_key.find(key);
    if (found == by_key.end()) {
      report.unexpected.push_back(key);
      return;
    }
    const StateEntry& entry = *found->second;
    by_key.erase(found);
    check_shape(entry, array, source);
    try {
      torch_dtype(array.dtype);  // refuses what to_tensor() would widen
      Tensor(entry.tensor).copy_(to_tensor(array));
      std::vector<std::uint8_t>().swap(array.bytes);
      if (loaded) loaded(key);
    } catch (const InputError& error) {
      throw InputError(source, key, error.problem());
    }
  });
  for (const StateEntry& entry : entries) {
    if (by_key.count(entry.key) > 0) report.missing.push_back(entry.key);
  }
  check_strict(report, source);
}

void load_trained_weights(torch::nn::Module& model, const RunModel& found, torch::Device device,
                          const LoadedKey& loaded) {
  load_state_file(model, found.checkpoint, loaded);
  for (const Tensor& parameter : model.parameters()) Tensor(parameter).requires_grad_(false);
  model.to(device);
  model.eval();
}

std::vector<torch::Dtype> published_dtypes(const torch::nn::Module& module,
                                           const std::vector<std::string>& half_precision_modules) {
  std::set<std::string> half(half_precision_modules.begin(), half_precision_modules.end());
  for (const auto& part : module.named_modules()) {
    const bool below = std::any_of(half_precision_modules.begin(), half_precision_modules.end(),
                                   [&](const std::string& name) { return lies_below(part.key() + ".", name); });
    if (!below || !is_linear_or_convolution(*part.value())) continue;
    for (const auto& item : part.value()->named_parameters(/*recurse=*/false))
      half.insert(part.key() + "." + item.key());
  }
  std::vector<torch::Dtype> dtypes;
  for (const StateEntry& entry : state_entries(module)) {
    const torch::Dtype own = entry.tensor.scalar_type();
    dtypes.push_back(half.count(entry.key) > 0 ? torch::kHalf : torch::isFloatingType(own) ? torch::kFloat32 : own);
  }
  return dtypes;
}

namespace {

/// In the file names of the average that a training evaluates, the first of its ema_rate: "_ema0.999_". Empty where no
/// config says.
std::string evaluated_average(const fs::path& folder) {
  std::error_code error;
  for (const fs::path& run : {folder, fs::absolute(folder).lexically_normal().parent_path()}) {
    const fs::path file = RunFolder{run}.config();
    if (!fs::is_regular_file(file, error)) continue;
    const Json config = read_json(file);
    const Json::json_pointer at("/trainer/args/ema_rate");
    if (!config.is_object() || !config.contains(at)) return "";
    const Json& rates = config.at(at);
    const Json first = rates.is_array() && !rates.empty() ? rates.front() : rates;
    return first.is_number() ? "_ema" + Json(first.get<double>()).dump() + "_" : "";
  }
  return "";
}

}  // namespace

fs::path newest_checkpoint(const fs::path& folder, const std::string& model, bool averaged) {
  const fs::path files = RunFolder{folder}.checkpoint_files();
  std::vector<std::string> names;
  std::set<std::int64_t> complete;
  for (const std::string& name : io::checkpoint_names(files)) {
    if (is_state(name)) complete.insert(io::step_of(name));
    if (name.rfind(model + "_", 0) == 0) names.push_back(name);
  }
  if (names.empty()) throw InputError(files.string(), "", "holds no weights of the model '" + model + "'");
  const std::string evaluated = averaged ? evaluated_average(folder) : "";
  const auto rank = [&](const std::string& name) {
    const std::int64_t step = io::step_of(name);
    const bool is_evaluated = !evaluated.empty() && name.compare(model.size(), evaluated.size(), evaluated) == 0;
    return std::make_tuple(complete.count(step) > 0, step, is_averaged(name, model) == averaged, is_evaluated);
  };
  // Of several averages without a config the first by name, which is how they are listed.
  return files / *std::max_element(names.begin(), names.end(),
                                   [&](const std::string& a, const std::string& b) { return rank(a) < rank(b); });
}

fs::path named_run(const fs::path& run, const std::string& name, const fs::path& config, const std::string& pointer) {
  if (name.empty()) throw InputError(config.string(), pointer, "names no run to decode with");
  std::error_code error;
  if (fs::is_directory(name, error)) return name;
  for (fs::path folder = fs::absolute(run).lexically_normal();; folder = folder.parent_path()) {
    if (fs::path(name).is_relative() && fs::is_directory(folder / name, error)) return folder / name;
    if (!folder.has_relative_path()) break;
  }
  throw InputError(config.string(), pointer,
                   "names the run \"" + name + "\", which is neither below the working directory nor beside this run");
}

bool has_training_state(const fs::path& run) {
  const std::vector<std::string> names = io::checkpoint_names(RunFolder{run}.checkpoint_files());
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

}  // namespace anigen::nn
