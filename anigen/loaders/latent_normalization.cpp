#include "anigen/loaders/latent_normalization.h"

#include <filesystem>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/loaders/source_options.h"

namespace anigen::loaders {
namespace {

constexpr const char* kShapeKey = "normalization";
constexpr const char* kSkeletonKey = "normalization_skl";
constexpr const char* kSkeletonSuffix = "_skl";
// The skeleton's deviations are bounded from below, as published. Skin channels of a structured latent vary as little.
constexpr float kLowestDeviation = 1e-3f;

// The file that an argument names; empty: none.
std::filesystem::path named_file(ConfigReader& args, const std::string& key) {
  const std::string name = args.text(key, "");
  return name.empty() ? std::filesystem::path() : file_of_dataset(name, args.text("data_dir", ""));
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
  if (!read_nested(lists, "slat_skl", listed.skeleton) && !read_nested(lists, "slat_skel", listed.skeleton)) {
    listed.skeleton = listed_statistics(lists, kSkeletonSuffix);
  }
  lists.finish();
  return listed;
}

// What `anigen-encode slat` proposes to the dataset of stage 5.
StreamStatistics proposed_statistics(const std::filesystem::path& file) {
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

}  // namespace

ChannelStatistics listed_statistics(ConfigReader& reader, const std::string& suffix) {
  const auto floats = [&](const std::string& key) {
    const std::vector<double> values = reader.numbers(key, {});
    return std::vector<float>(values.begin(), values.end());
  };
  ChannelStatistics result{floats("mean" + suffix), floats("std" + suffix)};
  if (!result.mean.empty() || !result.deviation.empty()) {
    result.check(reader.file(), reader.pointer_to("mean" + suffix));
  }
  return result;
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
  const std::filesystem::path file = named_file(args, key);
  if (file.empty()) return {};
  if (key == kSkeletonKey) return read_channel_statistics(file, "feats_skl_mean", "feats_skl_std", kLowestDeviation);
  return read_channel_statistics(file, "feats_mean", "feats_std", 0.0f);
}

StreamStatistics structured_latent_statistics(ConfigReader& args) {
  const Json* given = args.raw(kShapeKey);
  if (given == nullptr || given->is_null()) return {};
  if (given->is_object()) return listed_streams(args.object(kShapeKey));
  const std::filesystem::path file = named_file(args, kShapeKey);
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

torch::Tensor denormalised(const torch::Tensor& x, const ChannelStatistics& statistics) {
  if (statistics.empty()) return x;
  std::vector<std::int64_t> per_channel(static_cast<std::size_t>(x.dim()), 1);
  per_channel[1] = -1;
  const torch::Tensor mean = torch::tensor(statistics.mean).to(x.device()).view(per_channel);
  const torch::Tensor deviation = torch::tensor(statistics.deviation).to(x.device()).view(per_channel);
  return x * deviation + mean;
}

}  // namespace anigen::loaders
