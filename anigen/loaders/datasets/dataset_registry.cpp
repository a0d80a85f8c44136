#include "anigen/loaders/datasets/dataset_registry.h"

#include <functional>
#include <utility>

#include "anigen/loaders/datasets/feature_skeleton_dataset.h"
#include "anigen/loaders/datasets/sparse_structure_dataset.h"
#include "anigen/loaders/datasets/structure_latent_dataset.h"
#include "anigen/loaders/datasets/structured_latent_dataset.h"

namespace anigen::loaders {
namespace {

using Factory = std::function<Datasets(ConfigReader&, std::uint64_t)>;

template <typename Dataset, typename Options>
Datasets both(const Options& options, std::uint64_t seed) {
  TrainAndEval assets = select(options.sources);
  Datasets datasets;
  datasets.train = std::make_shared<const Dataset>(std::move(assets.train), options, seed);
  if (!assets.eval.empty()) datasets.eval = std::make_shared<const Dataset>(std::move(assets.eval), options, seed);
  return datasets;
}

template <typename Dataset, typename Options, typename... Extra>
Factory factory(Extra... extra) {
  return [=](ConfigReader& args, std::uint64_t seed) {
    const Options options = Options::read(args, extra...);
    args.finish();
    return both<Dataset>(options, seed);
  };
}

const std::vector<std::pair<std::string, Factory>>& registry() {
  static const std::vector<std::pair<std::string, Factory>> entries{
      {"AniGenSparseStructure", factory<SparseStructureDataset, SparseStructureOptions>()},
      {"AniGenSparseFeat2Skeleton", factory<FeatureSkeletonDataset, FeatureSkeletonOptions>()},
      {"AniGenSparseStructureLatent", factory<StructureLatentDataset, StructureLatentOptions>(false)},
      {"ImageConditionedAniGenSparseStructureLatent", factory<StructureLatentDataset, StructureLatentOptions>(true)},
      {"AniGenSLat", factory<StructuredLatentDataset, StructuredLatentOptions>(false)},
      {"AniGenImageConditionedSLat", factory<StructuredLatentDataset, StructuredLatentOptions>(true)}};
  return entries;
}

// Listed in the published registry without an implementation, or for text conditions, which no released model has.
const std::vector<std::string>& unimplemented() {
  static const std::vector<std::string> names{"AniGenSparseFeat2Render", "AniGenTextConditionedSLat",
                                              "TextConditionedSLat", "TextConditionedAniGenSparseStructureLatent"};
  return names;
}

}  // namespace

const std::vector<std::string>& dataset_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const auto& entry : registry()) all.push_back(entry.first);
    return all;
  }();
  return names;
}

Datasets make_datasets(ConfigReader dataset, std::uint64_t seed) {
  dataset.require("name");
  const std::string name = dataset.text("name", "");
  ConfigReader args = dataset.object("args");
  dataset.finish();
  for (const auto& [known, make] : registry()) {
    if (known == name) return make(args, seed);
  }
  for (const std::string& other : unimplemented()) {
    if (other == name) throw NotSupportedError(dataset.file(), dataset.pointer_to("name"), "dataset '" + name + "'");
  }
  std::string known;
  for (const std::string& word : dataset_names()) known += (known.empty() ? "" : ", ") + word;
  const std::string nearest = nearest_word(name, dataset_names());
  throw dataset.error("name", "unknown dataset '" + name.substr(0, 80) + "'; " +
                                  (nearest.empty() ? "known are " + known : "did you mean '" + nearest + "'?"));
}

}  // namespace anigen::loaders
