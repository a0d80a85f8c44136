#include "anigen/train/anymate_pretrained.h"

#include <algorithm>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/tensor_arrays.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;
namespace anymate = models::anymate;

// Where a part of the encoder lies in files of others.
struct Place {
  const char *theirs, *ours;
};

std::vector<Place> places(anymate::EncoderKind kind) {
  switch (kind) {
    case anymate::EncoderKind::kBert:
      return {{"model.point_backbone.", "encoder."}};
    case anymate::EncoderKind::kMichelangelo:
      return {{"model.shape_model.", "encoder."}, {"model.shape_projection", "encoder.shape_projection"}};
    default:
      throw NotSupportedError("", "/trainer/args/pretrained_encoder",
                              "pretrained weights of the encoder 'transformer': there are none");
  }
}

std::vector<fs::path> parts(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return {path};
  std::vector<fs::path> pickled, safe;
  fs::directory_iterator entries(path, error);
  for (; !error && entries != fs::directory_iterator(); entries.increment(error)) {
    const std::string name = entries->path().filename().string(), extension = entries->path().extension().string();
    if (extension == ".bin" && name.rfind("pytorch_model", 0) == 0) pickled.push_back(entries->path());
    if (extension == ".safetensors" && name.rfind("model", 0) == 0) safe.push_back(entries->path());
  }
  if (error) throw InputError(path.string(), "", "the folder cannot be read: " + error.message());
  std::vector<fs::path>& files = safe.empty() ? pickled : safe;
  std::sort(files.begin(), files.end());
  return files;
}

io::NamedArrays encoder_arrays(anymate::EncoderKind kind, const fs::path& path) {
  io::NamedArrays found;
  for (const fs::path& file : parts(path)) {
    for (const Place& place : places(kind)) {
      for (auto& [key, array] : io::read_state_below(file, place.theirs)) {
        found.emplace_back(place.ours + key, std::move(array));
      }
    }
  }
  if (found.empty()) {
    throw InputError(path.string(), "",
                     std::string("has no tensor '") + places(kind).front().theirs +
                         "…', which trainer.args.pretrained_encoder is to name");
  }
  return found;
}

// The columns that a narrower input layer has go before those that the model has beside them.
void widen_input(const torch::nn::Module& model, io::NamedArrays& arrays) {
  constexpr const char* kKey = "encoder.encoder.input_proj.weight";
  constexpr std::int64_t kHarmonics = 25;
  const auto found = std::find_if(arrays.begin(), arrays.end(), [](const auto& entry) { return entry.first == kKey; });
  if (found == arrays.end()) return;
  for (const models::StateEntry& entry : models::state_entries(model)) {
    if (entry.key != kKey) continue;
    const torch::Tensor narrow = models::to_tensor(found->second).to(torch::kFloat32);
    const torch::Tensor own = entry.tensor.detach().to(torch::kCPU, torch::kFloat32);
    if (narrow.dim() != 2 || narrow.size(0) != own.size(0) || narrow.size(1) + kHarmonics != own.size(1)) return;
    found->second =
        models::to_array(torch::cat({narrow, own.narrow(1, narrow.size(1), own.size(1) - narrow.size(1))}, 1));
  }
}

void require_all(const torch::nn::Module& model, const io::NamedArrays& arrays, const fs::path& path) {
  std::set<std::string> there;
  for (const auto& entry : arrays) there.insert(entry.first);
  for (const models::StateEntry& entry : models::state_entries(model)) {
    if (entry.key.rfind("encoder.", 0) == 0 && there.count(entry.key) == 0) {
      throw InputError(path.string(), entry.key, "the encoder's tensor is not among the pretrained weights");
    }
  }
}

}  // namespace

void load_pretrained_encoder(anymate::AnymateModelImpl& model, const fs::path& path) {
  io::NamedArrays arrays = encoder_arrays(model.options().encoder, path);
  widen_input(model, arrays);
  require_all(model, arrays, path);
  models::load_state_dict(model, arrays, models::LoadMode::kNonStrict, path.string());
  log::info("{}: the encoder starts from pretrained weights", path.string());
}

}  // namespace anigen::train
