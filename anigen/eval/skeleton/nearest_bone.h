#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/eval/skeleton/bone_samples.h"
#include "anigen/eval/skeleton/joint_graph.h"

namespace anigen::eval {

/// Distance from points to the nearest of many bones: set up once per skeleton (a tree of boxes), query many times.
/// Either to the bones as lines, exact, or to their samples, which are found by rounding the projection onto the line
/// and never listed. Queries are thread-safe.
class NearestBone {
 public:
  /// Exact point–segment distances. @param lines at least one
  explicit NearestBone(const std::vector<BoneLine>& lines);
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

}  // namespace anigen::eval
