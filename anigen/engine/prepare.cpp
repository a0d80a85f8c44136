#include "anigen/engine/prepare.h"

#include <mutex>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/engine/module.h"
#include "anigen/engine/option_names.h"
#include "anigen/engine/prepare_request.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/prepare/prepare_source.h"

namespace anigen::engine {

namespace {

namespace fs = std::filesystem;

constexpr OptionName kPrepareNames[] = {{"--clean", "cleaning"},
                                        {"--voxel-resolution", "resolution"},
                                        {"--augment", "poses"},
                                        {"--views", "views"},
                                        {"--view-size", "view_size"},
                                        {"--cond-views", "condition_views"},
                                        {"--cond-view-size", "condition_view_size"},
                                        {"--features", "features"},
                                        {"--feature-weights", "feature_weights"},
                                        {"--test-fraction", "test_fraction"},
                                        {"--output", "out"}};

anigen::prepare::PrepareSummary made_dataset(const std::vector<fs::path>& inputs, const fs::path& out,
                                             const PrepareOptions& options) {
  anigen::prepare::PrepareOptions dataset = dataset_request(options);
  dataset.out = out;
  add_sources(inputs, options, dataset);
  if (dataset.plan.wants("features")) {
    dataset.run.features = [](const anigen::prepare::FeatureOptions& features) {
      return engine_module("features").feature_extractor(features);
    };
  }
  return anigen::prepare::prepare_dataset(dataset);
}

/// One call at a time works on a folder: two processes share its leases, the calls of one process cannot.
class FolderInUse {
 public:
  explicit FolderInUse(const fs::path& folder) : folder_(fs::weakly_canonical(folder)) {
    const std::lock_guard<std::mutex> lock(mutex());
    if (!folders().insert(folder_).second)
      throw InputError(folder.string(), "", "another call of this process prepares this dataset");
  }
  ~FolderInUse() {
    const std::lock_guard<std::mutex> lock(mutex());
    folders().erase(folder_);
  }
  FolderInUse(const FolderInUse&) = delete;
  FolderInUse& operator=(const FolderInUse&) = delete;

 private:
  static std::mutex& mutex() {
    static std::mutex mutex;
    return mutex;
  }
  static std::set<fs::path>& folders() {
    static std::set<fs::path> folders;
    return folders;
  }
  fs::path folder_;
};

}  // namespace

PreparedDataset prepare(const std::vector<fs::path>& inputs, const fs::path& out, const PrepareOptions& options,
                        Job* job) {
  quiet_log();
  const JobScope scope(job);
  throw_if_interrupted();
  if (out.empty()) throw InputError("", "out", "name the folder to write the dataset to");
  const FolderInUse alone(out);
  const anigen::prepare::PrepareSummary summary =
      with_library_words(kPrepareNames, [&] { return made_dataset(inputs, out, options); });
  PreparedDataset result;
  result.assets = summary.prepared();
  result.variants = summary.variants;
  result.reused = summary.reused;
  result.train = summary.train;
  result.test = summary.test;
  result.unusable = summary.bad_skeleton;
  result.failed_steps = summary.failed_steps;
  result.bytes = summary.bytes;
  for (const anigen::prepare::Rejected& one : summary.rejected)
    result.rejected.push_back({one.file_identifier, one.reason, one.step});
  return result;
}

PreparedAsset prepare(const Asset& asset, const PrepareOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  throw_if_interrupted();
  const std::string name = asset.name.empty() ? "asset" : asset.name;
  anigen::prepare::PreparedAsset imported = with_library_words(kPrepareNames, [&] {
    return anigen::prepare::import_asset(asset, dataset_request(options).plan.cleaning, name);
  });
  throw_if_interrupted();
  PreparedAsset result;
  result.asset = std::move(imported.asset);
  const anigen::prepare::AssetRecord& record = imported.record;
  result.scale = record.scale;
  result.offset = {record.offset[0], record.offset[1], record.offset[2]};
  for (const anigen::prepare::CleaningFinding& finding : record.findings)
    result.findings.push_back(finding.rule + ": " + finding.detail);
  result.usable = anigen::prepare::usable(record, {});
  const Skeleton& skeleton = result.asset.skeleton;
  result.voxels = geometry::voxelize_surface(result.asset.mesh.vertices, result.asset.mesh.faces, options.resolution);
  result.skeleton_voxels = geometry::voxelize_bones(skeleton.positions(), skeleton.parents, options.resolution);
  return result;
}

}  // namespace anigen::engine
