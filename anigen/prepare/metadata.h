#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/config.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/prepare/cleaning.h"
#include "anigen/prepare/sources.h"

namespace anigen::prepare {

/// Descriptor of a skeleton, compared with those of other assets: where joints are in the skeleton's own bounding
/// box (centre at the origin, longest side 1), and how they hang together, whatever their order and names. Small enough
/// for a record, so that shards of a dataset can be compared after they were merged.
struct SkeletonDescriptor {
  std::string topology;              ///< equal for trees that are equal up to the order of children
  double length = 0.0;               ///< mean bone length, of the rounded places
  std::vector<std::int32_t> places;  ///< [J, 3] in 1/kPlaces of the longest side
  std::vector<std::int32_t> depths;  ///< [J] bones between the root and the joint

  static constexpr double kPlaces = 1000.0;
  std::size_t joints() const { return depths.size(); }
};

SkeletonDescriptor describe(const Skeleton& skeleton);

void to_json(Json& json, const SkeletonDescriptor& descriptor);
/// @throws InputError for lists that do not belong together
void from_json(const Json& json, SkeletonDescriptor& descriptor);

/// True when the trees are equal, every joint of each has one of the same depth in the other within `tolerance` (in the
/// unit of the longest side), and their mean bone lengths differ by no more than twice that.
bool near(const SkeletonDescriptor& a, const SkeletonDescriptor& b, double tolerance);

/// Published pipelines remove assets by skeleton similarity without saying which (docs/reference/anymate.md, 1.1); 1 %
/// is our choice.
inline constexpr double kNearSkeleton = 0.01;

/// For every descriptor the first earlier one that it is near to and that is itself near to none; nothing for those
/// that stay. Skeletons of fewer than `least_joints` joints are compared with none: small ones are alike by chance.
/// Compares only trees that are equal and of about one mean bone length, so the usual cost is far below n².
std::vector<std::optional<std::size_t>> near_duplicates(const std::vector<SkeletonDescriptor>& descriptors,
                                                        double tolerance = kNearSkeleton, std::size_t least_joints = 4);

/// Measurements of an asset on import. Depends on its content only, never on where it lay or on limits,
/// so that it can be kept beside the asset and reused.
struct AssetRecord {
  std::string source;  ///< "real" or "procedural:<family>"
  std::size_t num_joints = 0, num_vertices = 0, num_faces = 0;
  std::size_t animations = 0;      ///< clips of the file
  std::size_t max_influences = 0;  ///< of any vertex
  std::size_t invented_rows = 0;   ///< vertices without usable weights in the file
  double closest_bones = 0;        ///< see closest_bones()
  double outside_share = 0;        ///< see outside_share()
  double lowest_weight_sum = 1;    ///< of a vertex with weights in the file
  std::size_t repeated_names = 0;  ///< joints whose name in the file another joint has, too
  double scale = 1.0;              ///< normalised = scale · original + offset (world frame, Z up)
  std::vector<double> offset{0, 0, 0};
  std::vector<std::string> repairs;       ///< codes of the import notes, each once, in order
  std::vector<CleaningFinding> findings;  ///< what the cleaning rules changed
  SkeletonDescriptor skeleton;            ///< for near_duplicates() over a whole dataset
};

ANIGEN_JSON_RECORD(AssetRecord, source, num_joints, num_vertices, num_faces, animations, max_influences, invented_rows,
                   closest_bones, outside_share, lowest_weight_sum, repeated_names, scale, offset, repairs, findings,
                   skeleton)

/// No two bones are the same within limits.same_bone.
bool distinct_bones(const AssetRecord& record, const QualityLimits& limits);
/// Between min_joints and max_joints joints, all bones distinct, not too much of the skeleton outside the mesh: the
/// opposite is is_bad_skeleton.
bool usable(const AssetRecord& record, const QualityLimits& limits);
/// More rows than the limit were invented, or a vertex had weights that sum too low: is_bad_skin.
bool bad_skin(const AssetRecord& record, const QualityLimits& limits);

/// Chooses test entries: the `count` ids with the smallest hash of (seed, id). The choice does not depend on the
/// order of the ids, and adding an id moves at most one other across the border.
/// @return one flag per id, true for test @pre ids are unique
std::vector<bool> choose_test(const std::vector<std::string>& ids, std::size_t count, std::uint64_t seed);

/// round(fraction · n). @throws InputError when the fraction is not in [0, 1]
std::size_t test_count(std::size_t n, double fraction);

/// Input of the features of one asset.
struct FeatureRequest {
  const Asset& asset;                          ///< normalised into [-0.5, 0.5]³, Z up, in its bind pose
  const std::vector<geometry::Voxel>& voxels;  ///< [N] surface voxels, sorted
  int resolution = 64;                         ///< of the voxel grid
  std::filesystem::path views;                 ///< renders/<id>; empty when the extractor needs no views
};

/// Gives every surface voxel a vector: features/<name>/<id>.npz of the published layout (docs/reference/training.md,
/// 1.1). Made in the worker that uses it, never in the parent of a run, since an extractor may start a tensor library.
/// extract() is called from one thread at a time.
class FeatureExtractor {
 public:
  virtual ~FeatureExtractor() = default;

  /// The folder under features/ and the column feature_<name> of metadata.csv.
  virtual std::string name() const = 0;
  /// Inputs of the values besides the asset and its views: weights by content, number of views used, version
  /// of the method. Outputs made under another fingerprint are made again.
  virtual std::string fingerprint() const { return name(); }
  virtual int channels() const = 0;
  /// True when FeatureRequest::views must hold transforms.json and its pictures.
  virtual bool needs_views() const = 0;
  /// @return float16 [N, channels()], rows in the order of request.voxels
  /// @throws InputError naming a view that cannot be read
  virtual io::NdArray extract(const FeatureRequest& request) const = 0;
};

/// Extractor, as the command line names it.
struct FeatureOptions {
  std::string model;              ///< "surface", "dinov2_vits14_reg", "dinov2_vitl14_reg", …; empty for none
  std::filesystem::path weights;  ///< .pth or .safetensors of a learned model
  std::string device = "cpu";
};

/// Makes the extractor that the options name. @throws InputError for an unknown model or missing weights,
/// NotSupportedError for a model that this build cannot run
using FeatureExtractorFactory = std::function<std::unique_ptr<FeatureExtractor>(const FeatureOptions&)>;

}  // namespace anigen::prepare
