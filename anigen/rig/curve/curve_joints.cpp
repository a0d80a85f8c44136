#include "anigen/rig/curve/curve_joints.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"
#include "anigen/geometry/joint_names.h"
#include "anigen/geometry/segment.h"

namespace anigen::rig {
namespace {

using Curve = std::vector<Eigen::Vector3d>;

/// Points of a curve between `first` and `last` that its simplification keeps (Ramer 1972, Douglas and Peucker 1973).
void find_bends(const Curve& curve, std::size_t first, std::size_t last, double tolerance,
                std::vector<std::size_t>& kept) {
  std::size_t farthest = first;
  double most = tolerance;
  for (std::size_t i = first + 1; i < last; ++i) {
    const double d = geometry::distance_to_segment(curve[i], curve[first], curve[last]);
    if (d > most) {
      most = d;
      farthest = i;
    }
  }
  if (farthest == first) return;
  find_bends(curve, first, farthest, tolerance, kept);
  kept.push_back(farthest);
  find_bends(curve, farthest, last, tolerance, kept);
}

/// Points evenly along a part of a curve, without its ends.
void add_even_points(const Curve& curve, std::size_t first, std::size_t last, double longest, Curve& joints) {
  double length = 0.0;
  for (std::size_t i = first; i < last; ++i) length += (curve[i + 1] - curve[i]).norm();
  const int parts = std::max(1, static_cast<int>(std::ceil(length / longest - 1e-9)));
  double walked = 0.0;
  int next = 1;
  for (std::size_t i = first; i < last && next < parts; ++i) {
    const double step = (curve[i + 1] - curve[i]).norm();
    for (; next < parts && walked + step >= length * next / parts && step > 0.0; ++next) {
      const double t = std::clamp((length * next / parts - walked) / step, 0.0, 1.0);
      joints.emplace_back((1.0 - t) * curve[i] + t * curve[i + 1]);
    }
    walked += step;
  }
}

/// The joints of a curve between its ends, which are joints already.
Curve joints_along(const Curve& curve, const CurveJointRules& rules) {
  std::vector<std::size_t> kept{0};
  find_bends(curve, 0, curve.size() - 1, rules.bend, kept);
  kept.push_back(curve.size() - 1);
  Curve joints;
  for (std::size_t i = 0; i + 1 < kept.size(); ++i) {
    if (i > 0) joints.push_back(curve[kept[i]]);
    add_even_points(curve, kept[i], kept[i + 1], rules.longest_bone, joints);
  }
  return joints;
}

Eigen::Vector3d center_of_mass(const CurveTree& tree) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0.0;
  for (std::size_t p = 0; p < tree.size(); ++p) {
    double length = 0.0;
    for (const int q : tree.neighbours[p]) length += 0.5 * (tree.points[p] - tree.points[at(q)]).norm();
    const double weight = length * tree.radii[p] * tree.radii[p];
    sum += weight * tree.points[p];
    weights += weight;
  }
  return weights > 0.0 ? Eigen::Vector3d(sum / weights) : tree.points[0];
}

/// Joints as an undirected tree.
struct JointNet {
  Curve joints;
  std::vector<std::vector<int>> neighbours;

  int add(const Eigen::Vector3d& joint) {
    joints.push_back(joint);
    neighbours.emplace_back();
    return static_cast<int>(joints.size()) - 1;
  }
  void connect(int a, int b) {
    neighbours[at(a)].push_back(b);
    neighbours[at(b)].push_back(a);
  }
};

JointNet joint_net(const CurveTree& tree, const CurveJointRules& rules) {
  JointNet net;
  std::vector<int> joint_of(tree.size(), -1);
  for (std::size_t p = 0; p < tree.size(); ++p) {
    if (tree.neighbours[p].size() != 2) joint_of[p] = net.add(tree.points[p]);
  }
  for (int p = 0; at(p) < tree.size(); ++p) {
    if (joint_of[at(p)] < 0) continue;
    for (const int first : tree.neighbours[at(p)]) {
      Curve curve{tree.points[at(p)]};
      int before = p, here = first;
      while (true) {
        curve.push_back(tree.points[at(here)]);
        if (joint_of[at(here)] >= 0) break;
        const auto& around = tree.neighbours[at(here)];
        const int next = around[0] == before ? around[1] : around[0];
        before = here;
        here = next;
      }
      if (here < p) continue;  // seen from its other end
      int last = joint_of[at(p)];
      for (const Eigen::Vector3d& joint : joints_along(curve, rules)) {
        const int added = net.add(joint);
        net.connect(last, added);
        last = added;
      }
      net.connect(last, joint_of[at(here)]);
    }
  }
  return net;
}

}  // namespace

Skeleton curve_joints(const CurveTree& tree, const CurveJointRules& rules) {
  const JointNet net = joint_net(tree, rules);
  const Eigen::Vector3d center = center_of_mass(tree);
  const bool branches = std::any_of(net.neighbours.begin(), net.neighbours.end(),
                                    [](const std::vector<int>& around) { return around.size() > 2; });
  int root = -1;
  for (std::size_t j = 0; j < net.joints.size(); ++j) {
    if (branches && net.neighbours[j].size() < 3) continue;
    const bool nearer =
        root < 0 || (net.joints[j] - center).squaredNorm() < (net.joints[at(root)] - center).squaredNorm();
    if (nearer) root = static_cast<int>(j);
  }
  std::vector<int> order{root}, parents{-1}, number(net.joints.size(), -1);
  number[at(root)] = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (const int next : net.neighbours[at(order[i])]) {
      if (number[at(next)] >= 0) continue;
      number[at(next)] = static_cast<int>(order.size());
      order.push_back(next);
      parents.push_back(static_cast<int>(i));
    }
  }
  std::vector<Eigen::Vector3d> positions;
  for (const int joint : order) positions.push_back(net.joints[at(joint)]);
  return skeleton_from_joints(positions, parents, geometry::joint_names(positions, parents));
}

}  // namespace anigen::rig
