#include "anigen/loaders/latent_normalization.h"

#include <filesystem>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/loaders/source_options.h"

namespace anigen::loaders {
namespace {

constexpr const char* kShapeKey = "normalization";
constexpr const char* kSkeletonKey = "normalization_skl";
// The skeleton's deviations are bounded from below, as published.
constexpr float kLowestSkeletonDeviation = 1e-3f;

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
  const std::string name = args.text(key, "");
  if (name.empty()) return {};
  const std::filesystem::path file = file_of_dataset(name, args.text("data_dir", ""));
  if (key == kSkeletonKey) {
    return read_channel_statistics(file, "feats_skl_mean", "feats_skl_std", kLowestSkeletonDeviation);
  }
  return read_channel_statistics(file, "feats_mean", "feats_std", 0.0f);
}

void write_out_statistics(Json& dataset, const std::string& file) {
  if (!dataset.is_object() || !dataset.contains("args") || !dataset["args"].is_object()) return;
  const std::string name = dataset.value("name", Json()).is_string() ? dataset["name"].get<std::string>() : "";
  if (name.find("AniGenSparseStructureLatent") == std::string::npos) return;
  Json& args = dataset["args"];
  for (const char* key : {kShapeKey, kSkeletonKey}) {
    if (!args.contains(key) || !args[key].is_string()) continue;
    ConfigReader reader(args, file, "/dataset/args");
    const ChannelStatistics found = dense_latent_statistics(reader, key);
    if (!found.empty()) args[key] = {{"mean", found.mean}, {"std", found.deviation}};
  }
}

}  // namespace anigen::loaders
