#include "anigen/train/warm_start.h"

#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/text.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/trainable.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;

// Empty when there is neither.
fs::path pretrained_path(const fs::path& folder, const std::string& name) {
  for (const char* extension : {".safetensors", ".pt"}) {
    fs::path path = folder / (name + extension);
    std::error_code error;
    if (fs::is_regular_file(path, error)) return path;
  }
  return {};
}

io::NamedArrays with_prefix(io::NamedArrays arrays, const std::string& prefix) {
  if (prefix.empty()) return arrays;
  io::NamedArrays chosen;
  for (auto& [key, array] : arrays) {
    if (key.rfind(prefix, 0) == 0) chosen.emplace_back(key, std::move(array));
  }
  return chosen;
}

void refuse_unfilled(const torch::nn::Module& model, const std::set<std::string>& loaded,
                     const std::vector<PretrainedFile>& files, const fs::path& folder) {
  std::size_t unfilled = 0;
  std::string first;
  for (const std::string& key : nn::frozen_parameters(model)) {
    if (loaded.count(key) > 0) continue;
    if (unfilled++ == 0) first = key;
  }
  if (unfilled == 0) return;
  const std::string attribute = first.substr(0, first.find('.'));  // modules_to_freeze names these
  throw InputError((folder / (files.empty() ? "" : files.front().name)).string(), "",
                   std::to_string(unfilled) + " frozen parameters (the first: " + first + ") have no warm start; put " +
                       joined(files, ", ", &PretrainedFile::name) +
                       ".safetensors or .pt with them into that folder, name another with " +
                       "trainer.args.pretrained_dir, take \"" + attribute +
                       "\" out of the model's modules_to_freeze, or train the frozen branches too with " +
                       "trainer.args.warm_start \"none\"");
}

}  // namespace

WarmStartOptions WarmStartOptions::read(ConfigReader& args) {
  WarmStartOptions options;
  options.pretrained_dir = args.text("pretrained_dir", options.pretrained_dir.string());
  options.enabled = args.choice("warm_start", "published", {"published", "none"}) == "published";
  return options;
}

std::set<std::string> load_matching(torch::nn::Module& model, const io::NamedArrays& arrays,
                                    const std::string& source) {
  const nn::LoadReport report = nn::load_state_dict(model, arrays, nn::LoadMode::kNonStrict, source);
  const std::set<std::string> unexpected(report.unexpected.begin(), report.unexpected.end());
  std::set<std::string> loaded;
  for (const auto& entry : arrays) {
    if (unexpected.count(entry.first) == 0) loaded.insert(entry.first);
  }
  if (loaded.empty()) throw InputError(source, "", "none of its tensors belongs to the model; is it the right file?");
  log::info("{}: {} tensors loaded, {} of the file not used, {} of the model not in it", source, loaded.size(),
            unexpected.size(), report.missing.size());
  return loaded;
}

void load_pretrained(torch::nn::Module& model, const std::vector<PretrainedFile>& files,
                     const WarmStartOptions& options, std::set<std::string> loaded) {
  if (!options.enabled) return;
  for (const PretrainedFile& file : files) {
    const fs::path path = pretrained_path(options.pretrained_dir, file.name);
    if (path.empty()) {
      log::warn("no pretrained weights {}/{}.safetensors or .pt", options.pretrained_dir.string(), file.name);
      continue;
    }
    const io::NamedArrays arrays = with_prefix(io::read_state_dict(path), file.key_prefix);
    loaded.merge(load_matching(model, arrays, path.string()));
  }
  refuse_unfilled(model, loaded, files, options.pretrained_dir);
}

void share_frozen_weights(const torch::nn::Module& original, torch::nn::Module& replica) {
  const torch::NoGradGuard no_grad;
  const std::vector<nn::StateEntry> from = nn::state_entries(original);
  const std::vector<nn::StateEntry> to = nn::state_entries(replica);
  bool same = from.size() == to.size();
  for (std::size_t i = 0; same && i < from.size(); ++i) {
    same = from[i].key == to[i].key && from[i].tensor.requires_grad() == to[i].tensor.requires_grad();
    if (same && !from[i].tensor.requires_grad()) torch::Tensor(to[i].tensor).set_data(from[i].tensor.detach());
  }
  if (!same) throw Error("replicas of a model have different parameters");
}

}  // namespace anigen::train
