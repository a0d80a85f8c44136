#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/metrics/metric_skeleton.h"

namespace anigen::metrics {

/// The cells of a 64³ grid over [-1, 1]³ that lie inside the mesh (Anymate's `vox`).
class AnymateOccupancy {
 public:
  static constexpr int kResolution = 64;

  /// @param cells [V], each index in [0, 64) @throws InputError naming the cell
  explicit AnymateOccupancy(const std::vector<std::array<int, 3>>& cells);
  /// The cell round(32 p + 32) per axis, half to even, clipped to the grid.
  bool contains(const Eigen::Vector3d& p) const;

 private:
  std::vector<char> inside_;
};

/// A skeleton from probabilities of parents (docs/reference/anymate.md, 6.3), RigNet's procedure as Anymate carries it:
/// every step as published, deviations from the textbook included.
struct AnymateTree {
  JointTree tree;        ///< one root; a joint that no edge of positive cost reaches also becomes a root
  int root = 0;          ///< largest entry of the diagonal, the first of equals
  Eigen::MatrixXd cost;  ///< [J, J] before the tree was grown
};

/// @param joints [J], in [-1, 1]³ @param parents [J, J]: row i holds the probabilities of i's parents, the diagonal
///        that of being the root; finite, not negative
/// @throws InputError for no joint, another shape, or entries out of range
AnymateTree grow_anymate_tree(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents,
                              const AnymateOccupancy& inside);

/// −ln of the row-normalised probabilities without their diagonal, then bones with more than one sample (every 0.01)
/// outside the mesh cost twice the number of those samples, and half of it all between joints of the middle plane.
Eigen::MatrixXd anymate_bone_costs(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents,
                                   const AnymateOccupancy& inside);

/// Prim's algorithm from `root`; a joint's bones that fold back along the bone to its parent are made expensive once
/// the joint is in the tree. The cost of edge (u, v) is read at [u, v], u in the tree: for a matrix whose rows are
/// children that is the transposed entry, as published. @return [J] parents, -1 for the root and unreachable joints
std::vector<int> anymate_parents(const std::vector<Eigen::Vector3d>& joints, Eigen::MatrixXd cost, int root);

/// Anymate's joint metrics (docs/reference/anymate.md, 6.1). Distances and the threshold are in its frame: the object
/// in [-1, 1]³, longest side 2, so coordinates of the unit box must be doubled first.
inline constexpr double kAnymateJointThreshold = 0.1;

/// Result of their `earth_movers_distance`: not the exact transport cost but that of a log-domain Sinkhorn plan at
/// regularisation 1e-4 after at most 100 iterations, which is seldom converged (see exact transport for the true one).
struct ReleasedEmd {
  double cost = 0;       ///< Σ plan · distance
  double plan_mass = 0;  ///< Σ plan: 1 when converged; only the true joints' masses are right by construction
  int iterations = 0;
};

struct AnymateJointScore {
  std::string not_computed;  ///< the reason, or empty; the numbers below then are 0 and must not be averaged
  double cd = 0;             ///< ½ (mean nearest distance predicted → true + true → predicted)
  ReleasedEmd emd;
  double precision = 0;  ///< share of predicted joints strictly nearer than the threshold to some true joint
  double recall = 0;     ///< share of true joints strictly nearer than the threshold to some predicted joint
};

/// As published, fewer than 2 predicted joints are left out: not_computed says so.
/// @param predicted, truth finite @throws InputError without true joints
AnymateJointScore anymate_joint(const std::vector<Eigen::Vector3d>& predicted,
                                const std::vector<Eigen::Vector3d>& truth, double threshold = kAnymateJointThreshold);

/// The iteration exactly: masses 1/n and 1/m, potentials u = v = 0, cost M of Euclidean distances, ε = 1e-4;
/// u_i ← ε (ln 1/n − LSE_j((v_j − M_ij)/ε)), then v_j likewise; stops after 100, or when both Σ|Δu| and Σ|Δv| are below
/// 1e-3. @param predicted, truth at least one joint each
ReleasedEmd anymate_emd(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth);

/// Anymate's connectivity metrics on the true joints (docs/reference/anymate.md, 6.2).
struct AnymateConnectivityScore {
  double cross_entropy = 0;  ///< mean over rows of −Σ y ln(p + 1e-6), diagonals included
  double precision = 0, recall = 0;
};

/// Rows are joints, columns their possible parents; a root points at itself. As published, the parents that precision
/// and recall compare are the largest entries of matrices whose diagonals were set to 0 (a side effect of building the
/// skeleton first): a predicted root gets its best other joint, a true root joint 0. Then, with symmetric adjacency A:
/// precision = share of joints i with A_true[i, predicted parent of i]; recall = TP / (TP + FN), where TP is the count
/// of precision and FN counts joints i without A_predicted[i, true parent of i]. The first of equal entries counts.
/// @param predicted probabilities [J, J] @param truth one-hot rows [J, J]
/// @throws InputError for other shapes, no joints, or entries that are negative or not finite
AnymateConnectivityScore anymate_connectivity(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth);

/// −Σ_k y_ik ln(p_ik + 1e-6), [J].
Eigen::VectorXd anymate_cross_entropy(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth);

inline constexpr double kPuppeteerMerge = 0.0025;  ///< joints nearer than this are one
inline constexpr double kPuppeteerConnect = 0.02;  ///< components nearer than this are joined in a joint
/// Samples with more joints are in no table of its weights: its network reads so many, padded and masked.
inline constexpr std::size_t kPuppeteerMostJoints = 70;
inline constexpr std::size_t kLargestForest = 3000;  ///< joints of a forest whose components can be connected

/// Cleaning by MagicArticulate and Puppeteer of prediction and ground truth before they measure
/// (docs/reference/riggers.md, 4). Thresholds are for a skeleton in the unit box.
///  1. In index order, a joint takes in all later joints nearer than 0.0025 that no other took; the group is replaced
///     by its first joint, or by the tree's first root when that is in it. The result need not be a tree any more.
///  2. Bones from a joint to itself and repeated bones go, then joints that no bone uses, other than the root.
///  3. While there are several components, the nearest two joints of different ones are made one (nearer than 0.02;
///     the lower index stays) or get a bone (from the lower index).
/// A skeleton without bones keeps its merged joints: the published evaluation leaves it out.
/// @throws InputError for several components of more than kLargestForest joints
MetricSkeleton puppeteer_cleaned(const MetricSkeleton& skeleton);

}  // namespace anigen::metrics
