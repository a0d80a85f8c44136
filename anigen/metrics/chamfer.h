#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/metrics/metric_skeleton.h"

namespace anigen::metrics {

/// Evenly spaced points on one bone: start + i · step, i = 0 … last. Kept as a formula, since the nearest of them is
/// found by rounding a projection and no list of points is needed.
struct BoneSamples {
  Eigen::Vector3d start = Eigen::Vector3d::Zero(), step = Eigen::Vector3d::Zero();
  std::int64_t last = 0;

  Eigen::Vector3d point(std::int64_t i) const { return start + static_cast<double>(i) * step; }
};

/// More samples than this on one skeleton are refused: it is not in the unit box.
inline constexpr double kMostBoneSamples = 4e6;
inline constexpr double kSampleSpacing = 0.005;
inline constexpr int kSamplesPerBone = 100;

/// RigNet, MagicArticulate, Puppeteer: k = length / spacing rounded half to even steps, both ends included, a bone
/// shorter than half the spacing only its parent's end. Long bones so weigh more (docs/reference/training.md, 7.2).
/// @throws InputError beyond kMostBoneSamples
std::vector<BoneSamples> spaced_samples(const std::vector<geometry::Bone>& bones, double spacing = kSampleSpacing);

/// UniRig: `count` points per bone whatever its length, at i / count from the child towards the parent: the child's end
/// is one of them, the parent's is not (7.2 b). @throws InputError beyond kMostBoneSamples
std::vector<BoneSamples> counted_samples(const std::vector<geometry::Bone>& bones, int count = kSamplesPerBone);

/// Points of all bones; joints shared by bones count each time, as published.
std::int64_t sample_count(const std::vector<BoneSamples>& samples);

/// Distance from points to the nearest of many bones: set up once per skeleton (a tree of boxes), query many times.
/// Either to the bones as lines, exact, or to their samples, which are found by rounding the projection onto the line
/// and never listed. Queries are thread-safe.
class NearestBone {
 public:
  /// Exact point–segment distances. @param bones at least one
  explicit NearestBone(const std::vector<geometry::Bone>& bones);
  /// Distances to the nearest sample. @param samples at least one
  explicit NearestBone(const std::vector<BoneSamples>& samples);
  /// Distances to points. @param points at least one
  static NearestBone of_points(const std::vector<Eigen::Vector3d>& points);

  double distance(const Eigen::Vector3d& p) const;

  /// Means over many points: joints, or the samples of bones.
  double mean_distance(const std::vector<Eigen::Vector3d>& points) const;
  double mean_distance(const std::vector<BoneSamples>& samples) const;

 private:
  struct Piece {
    Eigen::Vector3d start, step;
    double inverse;  ///< 1 / |step|², 0 without length
    double last;     ///< largest parameter
  };
  struct Node {
    Eigen::Vector3d low, high;
    int begin, end;  ///< pieces
    int right;       ///< second child; the first follows the node; -1 for a leaf
  };
  void add(const Eigen::Vector3d& start, const Eigen::Vector3d& step, double last);
  void build();
  double squared_distance(const Piece& piece, const Eigen::Vector3d& p) const;

  std::vector<Piece> pieces_;
  std::vector<Node> nodes_;
  bool rounded_ = false;  ///< only whole parameters count
};

/// The public conventions for Chamfer distances between skeletons (docs/reference/training.md, 7.2;
/// docs/reference/rignet.md, 6; docs/reference/riggers.md, 4 and 5). All average the two directed means of un-squared
/// distances.
enum class SkeletonProtocol {
  kPaper,      ///< exact: bones are lines; bone-to-bone takes samples every 0.005 of one side to the lines of the other
  kRignet,     ///< bones are samples every 0.005, on both sides
  kUnirig,     ///< bones are 100 samples each, whatever their length; distances divided by the coordinate range
  kPuppeteer,  ///< as kRignet, after puppeteer_cleaned() of both sides (MagicArticulate, Puppeteer)
};

/// All, in the order above.
inline constexpr std::array<SkeletonProtocol, 4> kSkeletonProtocols = {
    SkeletonProtocol::kPaper, SkeletonProtocol::kRignet, SkeletonProtocol::kUnirig, SkeletonProtocol::kPuppeteer};

/// "paper", "rignet", "unirig", "puppeteer".
std::string name(SkeletonProtocol protocol);
/// @throws InputError listing the names
SkeletonProtocol parse_skeleton_protocol(const std::string& name);

/// Joint-to-joint, joint-to-bone and bone-to-bone distances, in the unit of the input.
struct SkeletonChamfer {
  double j2j = 0, j2b = 0, b2b = 0;
};

/// Both trees in the same frame, the unit box (longest side 1) for numbers comparable with published ones.
/// @param unirig_range width of the coordinates' range, which kUnirig divides by: 2 for coordinates in [-1, 1], as
///        published; 1 for the unit box, which gives the same number
/// @throws InputError for a skeleton too large to be sampled (see spaced_samples())
SkeletonChamfer skeleton_chamfer(const MetricSkeleton& predicted, const MetricSkeleton& truth,
                                 SkeletonProtocol protocol, double unirig_range = 1.0);

/// Bones as samples every 0.005: what kRignet means, and kPuppeteer on graphs that are clean.
SkeletonChamfer spaced_chamfer(const MetricSkeleton& predicted, const MetricSkeleton& truth);

}  // namespace anigen::metrics
