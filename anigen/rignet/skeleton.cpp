#include "anigen/rignet/skeleton.h"

#include <cmath>
#include <limits>

#include "anigen/anymate/blocks.h"
#include "anigen/core/error.h"
#include "anigen/nn/init.h"

namespace anigen::rignet {

namespace {

constexpr double kOwnWeight = 1e-10;  // of a point in its own mean, so that the mean exists

constexpr double kLowering = 1.3;  // of the least density

// The mask, unless it leaves nothing of what `within` keeps.
Tensor narrowed(const Tensor& within, const Tensor& mask) {
  const Tensor both = within & mask;
  return both.any().item<bool>() ? both : within;
}

Tensor with_mirror_images(const Tensor& points) {
  return torch::cat({points, points * torch::tensor({-1.0F, 1.0F, 1.0F})});
}

Tensor settled(Tensor points, const Tensor& attention, const Tensor& bandwidth, const JointClusters& options) {
  for (std::int64_t i = 0; i < options.most_shifts; ++i) {
    const Tensor next = mean_shifted(points, attention, bandwidth, /*step=*/1.0);
    const double moved = (next - points).norm(2, 1).sum().item<double>();
    points = next;
    if (moved < options.least_movement) break;
  }
  return points;
}

// Places in order of falling density, those that have a denser one within the bandwidth left out.
std::vector<std::int64_t> densest(const Tensor& points, const Tensor& density, double bandwidth) {
  const Tensor order = density.argsort(/*stable=*/true, 0, /*descending=*/true).contiguous();
  const auto at = points.accessor<float, 2>();
  const auto rank = order.accessor<std::int64_t, 1>();
  std::vector<std::int64_t> kept;
  for (std::int64_t i = 0; i < rank.size(0); ++i) {
    bool is_free = true;
    for (const std::int64_t other : kept) {
      double squared = 0.0;
      for (std::int64_t axis = 0; axis < 3; ++axis) {
        const double apart = at[rank[i]][axis] - at[other][axis];
        squared += apart * apart;
      }
      is_free = is_free && squared >= bandwidth * bandwidth;
    }
    if (is_free) kept.push_back(rank[i]);
  }
  return kept;
}

Tensor symmetric(const Tensor& joints, double middle) {
  const Tensor x = joints.select(1, 0);
  Tensor on = joints.index_select(0, (x.abs() <= middle).nonzero().flatten());
  on.select(1, 0).zero_();
  const Tensor beside = joints.index_select(0, (x > middle).nonzero().flatten());
  return torch::cat({on, with_mirror_images(beside)});
}

constexpr double kLogFloor = 1e-10, kMiddle = 0.02, kMiddleFactor = 0.5, kOutsideCost = 2.0;

bool in_middle(const Eigen::Vector3d& joint) { return std::abs(joint.x()) <= kMiddle; }

double edge_cost(const JointGraph& graph, Eigen::Index a, Eigen::Index b) {
  double cost = -std::log(graph.bone(a, b) + kLogFloor);
  if (graph.outside(a, b) > 1.0) cost = kOutsideCost * graph.outside(a, b);
  const auto joint = [&](Eigen::Index j) -> const Eigen::Vector3d& {
    return graph.joints[static_cast<std::size_t>(j)];
  };
  return in_middle(joint(a)) && in_middle(joint(b)) ? kMiddleFactor * cost : cost;
}

void check_graph(const JointGraph& graph) {
  const auto count = static_cast<Eigen::Index>(graph.joints.size());
  const auto square = [&](const Eigen::MatrixXd& m) { return m.rows() == count && m.cols() == count; };
  if (count == 0) throw InputError("", "joints", "there are none");
  if (!square(graph.bone) || !square(graph.outside) || graph.root.size() != count)
    throw InputError("", "joints", "are not as many as the probabilities are for");
  if (!graph.bone.allFinite() || !graph.root.allFinite() || !graph.outside.allFinite())
    throw InputError("", "bone", "holds probabilities that are not finite");
}

// The mirror image of each joint in x = 0, itself in the middle; empty when one has none or no joint is in the middle.
std::vector<Eigen::Index> twins(const std::vector<Eigen::Vector3d>& joints) {
  constexpr double kSame = 1e-5;  // fp32 coordinates in a box of side one
  std::vector<Eigen::Index> found(joints.size(), -1);
  bool any_in_middle = false;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (in_middle(joints[j])) {
      found[j] = static_cast<Eigen::Index>(j);
      any_in_middle = true;
    }
    const Eigen::Vector3d image(-joints[j].x(), joints[j].y(), joints[j].z());
    for (std::size_t other = j + 1; other < joints.size() && found[j] < 0; ++other) {
      if (found[other] >= 0 || (joints[other] - image).norm() > kSame) continue;
      found[j] = static_cast<Eigen::Index>(other);
      found[other] = static_cast<Eigen::Index>(j);
    }
    if (found[j] < 0) return {};
  }
  return any_in_middle ? found : std::vector<Eigen::Index>();
}

Eigen::Index nearest_in_middle(const std::vector<Eigen::Vector3d>& joints, Eigen::Index to) {
  Eigen::Index nearest = to;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const double distance = (joints[j] - joints[static_cast<std::size_t>(to)]).norm();
    if (!in_middle(joints[j]) || distance >= least) continue;
    least = distance;
    nearest = static_cast<Eigen::Index>(j);
  }
  return nearest;
}

// Prim's algorithm, one joint or one pair of twins at a time.
class GrowingTree {
 public:
  explicit GrowingTree(const JointGraph& graph)
      : graph_(graph),
        twins_(twins(graph.joints)),
        parents_(graph.joints.size(), -1),
        cheapest_(graph.joints.size(), std::numeric_limits<double>::infinity()),
        is_in_(graph.joints.size(), false) {}

  std::vector<int> grown_from(Eigen::Index root) {
    if (!twins_.empty()) root = nearest_in_middle(graph_.joints, root);
    for (Eigen::Index next = root; next >= 0; next = cheapest()) {
      add(next);
      const Eigen::Index twin = twins_.empty() ? next : twins_[at(next)];
      if (twin == next) continue;
      parents_[at(twin)] = static_cast<int>(twins_[at(parents_[at(next)])]);
      add(twin);
    }
    return parents_;
  }

 private:
  static std::size_t at(Eigen::Index j) { return static_cast<std::size_t>(j); }

  void add(Eigen::Index joint) {
    is_in_[at(joint)] = true;
    for (Eigen::Index j = 0; j < static_cast<Eigen::Index>(parents_.size()); ++j) {
      const double cost = edge_cost(graph_, joint, j);
      if (is_in_[at(j)] || cost >= cheapest_[at(j)]) continue;
      cheapest_[at(j)] = cost;
      parents_[at(j)] = static_cast<int>(joint);
    }
  }

  // Of the joints to come; -1 when there are none.
  Eigen::Index cheapest() const {
    Eigen::Index best = -1;
    for (Eigen::Index j = 0; j < static_cast<Eigen::Index>(parents_.size()); ++j) {
      const bool comes_with_its_twin = !twins_.empty() && twins_[at(j)] != j && graph_.joints[at(j)].x() < 0.0;
      if (is_in_[at(j)] || comes_with_its_twin) continue;
      if (best < 0 || cheapest_[at(j)] < cheapest_[at(best)]) best = j;
    }
    return best;
  }

  const JointGraph& graph_;
  std::vector<Eigen::Index> twins_;
  std::vector<int> parents_;
  std::vector<double> cheapest_;
  std::vector<bool> is_in_;
};

Eigen::MatrixXd square_of(const Tensor& matrix) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Tensor rows = matrix.to(torch::kCPU, torch::kFloat64).contiguous();
  return Eigen::Map<const Rows>(rows.data_ptr<double>(), rows.size(0), rows.size(1));
}

// max(h² − ‖p_i − p_j‖², 0).
Tensor epanechnikov(const Tensor& points, const Tensor& bandwidth) {
  anymate::require_shape(points, {-1, 3}, "points");
  anymate::require_shape(bandwidth, {}, "bandwidth");
  // Squares by products of matrices: distances count only where they are of the order of h, far above the rounding.
  const Tensor squares = points.square().sum(1);
  const Tensor apart = squares.unsqueeze(1) + squares.unsqueeze(0) - 2.0 * points.mm(points.t());
  return torch::relu(bandwidth.square() - apart.clamp_min(0.0));
}

}  // namespace

Tensor mean_shifted(const Tensor& points, const Tensor& attention, const Tensor& bandwidth, double step) {
  anymate::require_shape(attention, {points.size(0)}, "attention");
  const Tensor kernel = epanechnikov(points, bandwidth) * attention.unsqueeze(0);
  const Tensor weight = kernel.sum(1, true) + kOwnWeight;
  const Tensor mean = (kernel.mm(points) + kOwnWeight * points) / weight;
  return points + step * (mean - points);
}

Tensor clustered_joints(const Tensor& points, const Tensor& attention, const Tensor& inside,
                        const JointClusters& options) {
  anymate::require_shape(points, {-1, 3}, "points");
  const std::int64_t count = points.size(0);
  anymate::require(count > 0, "points", "there are none");
  anymate::require_shape(attention, {count}, "attention");
  anymate::require_shape(inside, {count}, "inside");
  const torch::NoGradGuard no_grad;
  const Tensor all = points.to(torch::kCPU, torch::kFloat32), attends = attention.to(torch::kCPU, torch::kFloat32);
  anymate::require(all.isfinite().all().item<bool>() && attends.isfinite().all().item<bool>(), "points",
                   "or their attention are not finite");
  Tensor kept = narrowed(torch::ones({count}, torch::kBool), inside.to(torch::kCPU));
  kept = narrowed(kept, attends > options.least_attention);
  const Tensor rows = kept.nonzero().flatten();
  Tensor moved = all.index_select(0, rows), weight = attends.index_select(0, rows);
  if (options.mirrored) {
    moved = with_mirror_images(moved);
    weight = torch::cat({weight, weight});
  }
  const Tensor bandwidth = torch::tensor(options.bandwidth, torch::kFloat32);
  moved = settled(moved, weight, bandwidth, options).contiguous();
  Tensor density = epanechnikov(moved, bandwidth).sum(1);
  density = (density / density.sum()).contiguous();

  for (double least = options.least_density;; least /= kLowering) {
    const Tensor dense = (density > least).nonzero().flatten();
    const Tensor places = moved.index_select(0, dense).contiguous();
    const auto peaks = densest(places, density.index_select(0, dense).contiguous(), options.bandwidth);
    const Tensor joints = places.index_select(0, torch::tensor(peaks, torch::kInt64));
    const Tensor found = options.mirrored ? symmetric(joints, options.middle) : joints;
    if (found.size(0) >= 2 || dense.size(0) == moved.size(0)) return found.size(0) > 0 ? found : joints;
  }
}

std::vector<int> skeleton_tree(const JointGraph& graph) {
  check_graph(graph);
  Eigen::Index root = 0;
  graph.root.maxCoeff(&root);
  return GrowingTree(graph).grown_from(root);
}

JointClusters clusters_of(RignetModelImpl& model) {
  JointClusters options;
  options.bandwidth = model.network<JointNetworkImpl>().bandwidth().abs().item<double>();
  options.mirrored = model.options().mirrored;
  return options;
}

PredictedTree predicted_tree(RignetModelImpl& model, const ConnectivityInput& input, const Tensor& outside) {
  const torch::NoGradGuard no_grad;
  const std::int64_t joints = input.joints.positions.size(0);
  anymate::require_shape(outside, {joints, joints}, "outside");
  const auto chances = connectivity_chances(model.network<ConnectivityNetworkImpl>().forward(input), input);
  PredictedTree tree;
  tree.graph.joints = nn::points_of<double>(input.joints.positions, "joints");
  tree.graph.bone = square_of(chances.bone);
  tree.graph.root = square_of(chances.root.unsqueeze(1));
  tree.graph.outside = square_of(outside);
  tree.parents = skeleton_tree(tree.graph);
  return tree;
}

Tensor predicted_weights(RignetModelImpl& model, const MeshGraph& graph, const BoneSlots& slots, std::int64_t bones) {
  const torch::NoGradGuard no_grad;
  const Tensor shares = torch::softmax(model.network<SkinNetworkImpl>().forward(graph, slots), 1);
  return scattered_to_bones(shares, slots.bones, bones).to(torch::kCPU, torch::kFloat32);
}

}  // namespace anigen::rignet
