#include "anigen/models/lpips_weights.h"

#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/tensor_arrays.h"
#include "anigen/models/weight_checks.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

/// The stage (1 to 5) of a layer of torchvision's list: each ends before the next pooling.
int stage_of(int layer) { return layer < 4 ? 1 : layer < 9 ? 2 : layer < 16 ? 3 : layer < 23 ? 4 : 5; }

/// Names under which a weight is published.
std::vector<std::string> names_of(const std::string& key) {
  const std::string trunk = "features.";
  if (key.compare(0, trunk.size(), trunk) != 0) return {key};
  const std::string rest = key.substr(trunk.size());  // "28.weight"
  return {key, "net.slice" + std::to_string(stage_of(std::stoi(rest))) + "." + rest};
}

struct Found {
  const std::string* file;
  std::string name;
  const io::NdArray* array;
};

Found find_weight(const std::string& key, const std::vector<LpipsArrays>& sources) {
  std::optional<Found> found;
  std::string files;
  for (const LpipsArrays& source : sources) {
    files += (files.empty() ? "" : ", ") + source.file;
    for (const std::string& name : names_of(key)) {
      const io::NdArray* array = io::find(source.arrays, name);
      if (array == nullptr) continue;
      if (found) throw InputError(source.file, name, "stands in " + *found->file + " too, as " + found->name);
      found = Found{&source.file, name, array};
    }
  }
  if (found) return *found;
  throw InputError(files, key,
                   "is missing; LPIPS needs the convolutions of VGG16 (torchvision's vgg16: features.0 … features.28) "
                   "and the linear heads of the lpips package (lin0 … lin4)");
}

Tensor checked(const Found& found, torch::IntArrayRef shape) {
  const io::NdArray& array = *found.array;
  if (torch::IntArrayRef(array.shape) != shape) {
    throw InputError(
        *found.file, found.name,
        "has shape " + nn::shape_text(array.shape) + " where LPIPS with VGG16 has " + nn::shape_text(shape));
  }
  if (!is_floating_point(array.dtype))
    throw InputError(*found.file, found.name, std::string("holds ") + io::name_of(array.dtype) + ", not weights");
  const Tensor values = to_tensor(array).to(torch::kFloat32);
  if (!torch::isfinite(values).all().item<bool>())
    throw InputError(*found.file, found.name, "holds values that are not finite");
  return values;
}

}  // namespace

void set_lpips_weights(LpipsImpl& lpips, const std::vector<LpipsArrays>& sources) {
  std::vector<std::pair<Tensor, Tensor>> copies;
  for (const StateEntry& entry : state_entries(lpips))
    copies.emplace_back(entry.tensor, checked(find_weight(entry.key, sources), entry.tensor.sizes()));
  const torch::NoGradGuard no_grad;
  for (auto& [weight, values] : copies) weight.copy_(values);
}

Lpips load_lpips(const std::vector<std::filesystem::path>& files) {
  std::vector<LpipsArrays> sources;
  for (const std::filesystem::path& file : files) sources.push_back({file.string(), io::read_state_dict(file)});
  Lpips lpips;
  set_lpips_weights(*lpips, sources);
  return lpips;
}

}  // namespace anigen::models
