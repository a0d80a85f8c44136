#include "anigen/data/latent_files.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/core/text.h"
#include "anigen/data/voxel_files.h"
#include "anigen/io/arrays/npz.h"

namespace anigen::data {

namespace {

namespace fs = std::filesystem;

std::string text_of(const std::vector<std::int64_t>& shape) {
  return "[" + joined(shape, ", ", [](auto size) { return size < 0 ? "*" : std::to_string(size); }) + "]";
}

void check(const io::NdArray& array, const ArraySpec& spec, const std::string& file) {
  bool fits = array.shape.size() == spec.shape.size();
  for (std::size_t i = 0; fits && i < spec.shape.size(); ++i)
    fits = spec.shape[i] < 0 || spec.shape[i] == array.shape[i];
  if (!fits)
    throw InputError(file, spec.name, "has shape " + text_of(array.shape) + ", expected " + text_of(spec.shape));
  std::size_t count = 0;
  if (!io::count_elements(array.shape, io::size_of(array.dtype), count) || count > spec.most) {
    throw InputError(
        file, spec.name,
        "has shape " + text_of(array.shape) + "; more than " + std::to_string(spec.most) + " numbers are not read");
  }
}

LatentGrid grid(const io::NamedArrays& arrays, const std::string& name, const std::string& file) {
  const std::vector<std::int64_t>& shape = named(arrays, name).shape;
  if (shape[1] != shape[2] || shape[1] != shape[3] || shape[0] == 0 || shape[1] == 0)
    throw InputError(file, name, "is not of the shape [C, r, r, r]");
  LatentGrid latent;
  std::copy_n(shape.begin(), 4, latent.shape.begin());
  latent.values = finite_numbers(arrays, name, file);
  return latent;
}

std::vector<float> channels(const io::NamedArrays& arrays, const std::string& name, const std::string& file) {
  const io::NdArray* array = io::find(arrays, name);
  if (array == nullptr) throw InputError(file, name, "no such array");
  const auto wide = std::count_if(array->shape.begin(), array->shape.end(), [](std::int64_t n) { return n != 1; });
  if (wide > 1) throw InputError(file, name, "has more than one dimension; one number per channel is expected");
  return finite_numbers(arrays, name, file);
}

constexpr const char* kShapeKey = "normalization";
constexpr const char* kSkeletonKey = "normalization_skl";
constexpr const char* kSkeletonSuffix = "_skl";
// The skeleton's deviations are bounded from below, as published. Skin channels of a structured latent vary as little.
constexpr float kLowestDeviation = 1e-3f;

// The file that an argument names; empty: none.
fs::path named_file(ConfigReader& args, const std::string& key) {
  const std::string name = args.text(key, "");
  return name.empty() ? fs::path() : file_of_dataset(name, args.text("data_dir", ""));
}

// Lists `mean<suffix>` and `std<suffix>` of numbers, one per channel; both missing: none.
ChannelStatistics listed_statistics(ConfigReader& reader, const std::string& suffix) {
  const auto floats = [&](const std::string& key) {
    const std::vector<double> values = reader.numbers(key, {});
    return std::vector<float>(values.begin(), values.end());
  };
  ChannelStatistics result{floats("mean" + suffix), floats("std" + suffix)};
  if (!result.mean.empty() || !result.deviation.empty())
    result.check(reader.file(), reader.pointer_to("mean" + suffix));
  return result;
}

// Lists under a name of their own, as the published pipeline also understands them; nothing without that name.
bool read_nested(ConfigReader& lists, const char* name, ChannelStatistics& into) {
  if (!lists.has(name)) return false;
  ConfigReader nested = lists.object(name);
  into = listed_statistics(nested, "");
  nested.finish();
  return true;
}

StreamStatistics listed_streams(ConfigReader lists) {
  StreamStatistics listed;
  if (!read_nested(lists, "slat", listed.shape)) listed.shape = listed_statistics(lists, "");
  if (!read_nested(lists, "slat_skl", listed.skeleton) && !read_nested(lists, "slat_skel", listed.skeleton))
    listed.skeleton = listed_statistics(lists, kSkeletonSuffix);
  lists.finish();
  return listed;
}

// Statistics that `anigen-encode slat` proposes to the dataset of stage 5.
StreamStatistics proposed_statistics(const fs::path& file) {
  const Json json = read_json(file);
  ConfigReader top(json, file.string());
  top.require(kShapeKey);
  return listed_streams(top.object(kShapeKey));
}

// The arguments of a dataset whose name contains `class_name`; nullptr for another dataset.
Json* args_of_class(Json& dataset, const std::string& class_name) {
  if (!dataset.is_object() || !dataset.contains("args") || !dataset["args"].is_object()) return nullptr;
  const std::string name = dataset.value("name", Json()).is_string() ? dataset["name"].get<std::string>() : "";
  return name.find(class_name) == std::string::npos ? nullptr : &dataset["args"];
}

bool names_a_file(const Json& args, const char* key) { return args.contains(key) && args[key].is_string(); }

void add_lists(Json& lists, const ChannelStatistics& statistics, const std::string& suffix) {
  if (statistics.empty()) return;
  lists["mean" + suffix] = statistics.mean;
  lists["std" + suffix] = statistics.deviation;
}

// Two arrays of an NPZ; dimensions of size 1 around the channels are allowed.
ChannelStatistics read_channel_statistics(const fs::path& path, const std::string& mean, const std::string& deviation,
                                          float lowest) {
  const std::string file = path.string();
  const io::NamedArrays arrays = io::read_npz(path, {mean, deviation});
  ChannelStatistics statistics{channels(arrays, mean, file), channels(arrays, deviation, file)};
  for (float& value : statistics.deviation) value = std::max(value, lowest);
  statistics.check(file, mean);
  return statistics;
}

void require_channels(std::size_t count, std::size_t normalized, const std::string& what) {
  if (count == normalized) return;
  throw InputError(what, "",
                   std::to_string(count) + " channels, but the normalization has " + std::to_string(normalized));
}

}  // namespace

io::NamedArrays read_arrays(const fs::path& path, const std::vector<ArraySpec>& specs) {
  const std::string file = path.string();
  // Pickled arrays have no header of numbers; they are checked once they are read.
  const io::NamedArrays headers = io::read_npz_headers(path);
  std::vector<std::string> names;
  for (const ArraySpec& spec : specs) {
    names.push_back(spec.name);
    if (const io::NdArray* header = io::find(headers, spec.name)) check(*header, spec, file);
  }
  io::NamedArrays arrays = io::read_npz(path, names);
  for (const ArraySpec& spec : specs) {
    const io::NdArray* array = io::find(arrays, spec.name);
    if (array == nullptr) throw InputError(file, spec.name, "no such array");
    check(*array, spec, file);
  }
  return arrays;
}

const io::NdArray& named(const io::NamedArrays& arrays, const std::string& name) {
  const io::NdArray* found = io::find(arrays, name);
  if (found == nullptr) throw Error("array '" + name + "' was not asked for");
  return *found;
}

std::string place_of(const std::string& name, const std::vector<std::int64_t>& shape, std::size_t flat) {
  std::string index;
  for (std::size_t axis = shape.size(); axis-- > 0;) {
    const auto size = static_cast<std::size_t>(shape[axis]);
    index = std::to_string(flat % size) + (index.empty() ? "" : ", " + index);
    flat /= size;
  }
  return name + "[" + index + "]";
}

std::vector<float> finite_numbers(const io::NamedArrays& arrays, const std::string& name, const std::string& file) {
  const io::NdArray& array = named(arrays, name);
  std::vector<float> values = array.as<float>();
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) throw InputError(file, place_of(name, array.shape, i), "is not finite");
  }
  return values;
}

std::vector<std::int64_t> whole_numbers(const io::NamedArrays& arrays, const std::string& name,
                                        const std::string& file) {
  try {
    return named(arrays, name).as<std::int64_t>();
  } catch (const Error& error) {
    throw InputError(file, name, error.what());
  }
}

StructureLatent read_structure_latent(const fs::path& path) {
  constexpr std::size_t kMost = std::size_t{1} << 26;
  const io::NamedArrays arrays =
      read_arrays(path, {{"mean", {-1, -1, -1, -1}, kMost}, {"mean_skl", {-1, -1, -1, -1}, kMost}});
  StructureLatent latent{grid(arrays, "mean", path.string()), grid(arrays, "mean_skl", path.string())};
  if (latent.mean.shape[1] != latent.mean_skl.shape[1]) {
    throw InputError(path.string(), "mean_skl",
                     "has edge " + std::to_string(latent.mean_skl.shape[1]) + ", 'mean' has " +
                         std::to_string(latent.mean.shape[1]));
  }
  return latent;
}

void ChannelStatistics::check(const std::string& file, const std::string& place) const {
  if (mean.empty() || mean.size() != deviation.size()) {
    throw InputError(
        file, place,
        std::to_string(mean.size()) + " means and " + std::to_string(deviation.size()) + " standard deviations");
  }
  for (std::size_t c = 0; c < mean.size(); ++c) {
    if (!std::isfinite(mean[c]) || !std::isfinite(deviation[c]) || !(deviation[c] > 0.0f)) {
      throw InputError(file, place,
                       "channel " + std::to_string(c) + ": mean " + std::to_string(mean[c]) + ", standard deviation " +
                           std::to_string(deviation[c]) + "; it must be positive");
    }
  }
}

void ChannelStatistics::normalize_planes(std::vector<float>& values, std::size_t channel_count,
                                         const std::string& what) const {
  if (empty()) return;
  require_channels(channel_count, mean.size(), what);
  const std::size_t count = values.size() / channel_count;
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = (values[i] - mean[i / count]) / deviation[i / count];
}

void ChannelStatistics::normalize_rows(std::vector<float>& values, std::size_t channel_count,
                                       const std::string& what) const {
  if (empty()) return;
  require_channels(channel_count, mean.size(), what);
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = (values[i] - mean[i % channel_count]) / deviation[i % channel_count];
}

ChannelStatistics dense_latent_statistics(ConfigReader& args, const std::string& key) {
  const Json* given = args.raw(key);
  if (given == nullptr || given->is_null()) return {};
  if (given->is_object()) {
    ConfigReader lists = args.object(key);
    const ChannelStatistics listed = listed_statistics(lists, "");
    lists.finish();
    return listed;
  }
  const fs::path file = named_file(args, key);
  if (file.empty()) return {};
  if (key == kSkeletonKey) return read_channel_statistics(file, "feats_skl_mean", "feats_skl_std", kLowestDeviation);
  return read_channel_statistics(file, "feats_mean", "feats_std", 0.0f);
}

StreamStatistics structured_latent_statistics(ConfigReader& args) {
  const Json* given = args.raw(kShapeKey);
  if (given == nullptr || given->is_null()) return {};
  if (given->is_object()) return listed_streams(args.object(kShapeKey));
  const fs::path file = named_file(args, kShapeKey);
  if (file.empty()) return {};
  if (file.extension() == ".json") return proposed_statistics(file);
  return {read_channel_statistics(file, "feats_mean", "feats_std", kLowestDeviation),
          read_channel_statistics(file, "feats_skl_mean", "feats_skl_std", kLowestDeviation)};
}

void write_out_statistics(Json& dataset, const std::string& file) {
  if (Json* args = args_of_class(dataset, "AniGenSparseStructureLatent")) {
    for (const char* key : {kShapeKey, kSkeletonKey}) {
      if (!names_a_file(*args, key)) continue;
      ConfigReader reader(*args, file, "/dataset/args");
      const ChannelStatistics found = dense_latent_statistics(reader, key);
      Json lists;
      add_lists(lists, found, "");
      if (!found.empty()) (*args)[key] = lists;
    }
  }
  for (const char* name : {"AniGenSLat", "AniGenImageConditionedSLat"}) {
    Json* args = args_of_class(dataset, name);
    if (args == nullptr || !names_a_file(*args, kShapeKey)) continue;
    ConfigReader reader(*args, file, "/dataset/args");
    const StreamStatistics found = structured_latent_statistics(reader);
    Json lists;
    add_lists(lists, found.shape, "");
    add_lists(lists, found.skeleton, kSkeletonSuffix);
    if (!lists.is_null()) (*args)[kShapeKey] = lists;
  }
}

namespace {

// Numbers per channel in the shape that multiplies x.
torch::Tensor along_channels(const std::vector<float>& numbers, const torch::Tensor& x) {
  std::vector<std::int64_t> per_channel(static_cast<std::size_t>(x.dim()), 1);
  per_channel[1] = -1;
  return torch::tensor(numbers).to(x.device()).view(per_channel);
}

}  // namespace

torch::Tensor normalised(const torch::Tensor& x, const ChannelStatistics& statistics) {
  if (statistics.empty()) return x;
  return (x - along_channels(statistics.mean, x)) / along_channels(statistics.deviation, x);
}

torch::Tensor denormalised(const torch::Tensor& x, const ChannelStatistics& statistics) {
  if (statistics.empty()) return x;
  return x * along_channels(statistics.deviation, x) + along_channels(statistics.mean, x);
}

void LatentDatasetOptions::read_latents(ConfigReader& reader, bool conditioned, const std::string& flag) {
  image_conditioned = conditioned;
  sources.read_common(reader);
  ConfigFields f(reader);
  f("latent_model", latent_model, kRequired);
  if (image_conditioned) {
    f("image_size", image_size, {1, 4096});
    f("condition", condition, {{"color", ConditionPictures::kColor}, {"normal", ConditionPictures::kNormals}});
  }
  f("cache_mb", cache_mb, {0, std::int64_t{1} << 20});
  RowFilter& filter = sources.filter;
  filter.required_flags = {flag + latent_model};
  if (image_conditioned) filter.required_flags.push_back("cond_rendered");
  filter.drop_bad_skin = true;
}

void LatentDatasetOptions::append_condition_files(const AssetId& asset, std::vector<fs::path>& files) const {
  if (!image_conditioned) return;
  files.push_back(condition_folder(asset) / "transforms.json");
  // Views are colour first, normals only when asked for: often a dataset has none.
  if (condition == ConditionPictures::kNormals) files.push_back(first_normal_picture(condition_folder(asset)));
}

std::vector<float> LatentDatasetOptions::condition_picture(const AssetId& asset, std::uint64_t seed,
                                                           std::uint64_t position, PictureCache& cache,
                                                           std::optional<std::size_t> view) const {
  if (!image_conditioned) return {};
  if (view) return cache.read(condition_folder(asset), image_size, *view, condition);
  Rng drawn(seed, "condition view", position);
  return cache.read(condition_folder(asset), image_size, drawn, condition);
}

torch::Tensor LatentDatasetOptions::condition_batch(const std::vector<const std::vector<float>*>& pictures,
                                                    const std::vector<std::string>& ids) const {
  if (!image_conditioned) return {};
  return stack(pictures, {3, image_size, image_size}, ids, "cond");
}

}  // namespace anigen::data
