#include "anigen/eval/skeleton/anymate_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

constexpr double kSpacing = 0.01, kMiddlePlane = 0.02, kFoldBack = 1e8;
constexpr std::size_t kMostJoints = 2000;

std::size_t cell(const std::array<int, 3>& index) {
  constexpr int n = AnymateOccupancy::kResolution;
  return static_cast<std::size_t>((index[0] * n + index[1]) * n + index[2]);
}

void check_input(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents) {
  const auto n = static_cast<Eigen::Index>(joints.size());
  if (joints.empty()) throw InputError("", "joints", "the skeleton has no joint");
  if (joints.size() > kMostJoints) throw InputError("", "joints", "more than 2000 joints");
  if (parents.rows() != n || parents.cols() != n) {
    throw InputError("", "connectivity",
                     "expected " + std::to_string(n) + " x " + std::to_string(n) + ", found " +
                         std::to_string(parents.rows()) + " x " + std::to_string(parents.cols()));
  }
  if (!parents.allFinite() || parents.minCoeff() < 0.0)
    throw InputError("", "connectivity", "a probability is negative or not finite");
  for (std::size_t j = 0; j < joints.size(); ++j) {
    // The published frame is [-1, 1]; the bound keeps the number of samples along a bone small.
    if (!(joints[j].cwiseAbs().maxCoeff() <= 100.0) || !joints[j].allFinite())
      throw InputError("", "joints[" + std::to_string(j) + "]", "the position is not finite or far outside [-1, 1]");
  }
}

int samples_outside(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const AnymateOccupancy& inside) {
  const double steps = std::nearbyint((b - a).norm() / kSpacing);
  int outside = 0;
  for (int i = 1; i <= static_cast<int>(steps); ++i) outside += !inside.contains(a + (i / steps) * (b - a));
  return outside;
}

Eigen::Vector3d direction(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d along = to - from;
  const double length = along.norm();
  return length > 0.0 ? Eigen::Vector3d(along / length) : Eigen::Vector3d::Zero();
}

}  // namespace

AnymateOccupancy::AnymateOccupancy(const std::vector<std::array<int, 3>>& cells)
    : inside_(static_cast<std::size_t>(kResolution) * kResolution * kResolution, 0) {
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const auto [low, high] = std::minmax_element(cells[i].begin(), cells[i].end());
    if (*low < 0 || *high >= kResolution)
      throw InputError("", "vox[" + std::to_string(i) + "]", "an index is outside [0, 64)");
    inside_[cell(cells[i])] = 1;
  }
}

bool AnymateOccupancy::contains(const Eigen::Vector3d& p) const {
  std::array<int, 3> index{};
  for (int k = 0; k < 3; ++k) {
    const double scaled = std::clamp(32.0 * p[k] + 32.0, 0.0, static_cast<double>(kResolution - 1));
    index[static_cast<std::size_t>(k)] = static_cast<int>(std::nearbyint(scaled));
  }
  return inside_[cell(index)] != 0;
}

Eigen::MatrixXd anymate_bone_costs(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents,
                                   const AnymateOccupancy& inside) {
  check_input(joints, parents);
  Eigen::MatrixXd cost = parents;
  cost.diagonal().setZero();
  for (Eigen::Index i = 0; i < cost.rows(); ++i) cost.row(i) /= cost.row(i).sum() + 1e-6;
  cost = -(cost.array() + 1e-10).log();
  for (Eigen::Index i = 0; i < cost.rows(); ++i) {
    for (Eigen::Index j = i + 1; j < cost.cols(); ++j) {
      const Eigen::Vector3d &a = joints[static_cast<std::size_t>(i)], &b = joints[static_cast<std::size_t>(j)];
      const int outside = samples_outside(a, b, inside);
      if (outside > 1) cost(i, j) = cost(j, i) = 2.0 * outside;
      if (std::abs(a.x()) < kMiddlePlane && std::abs(b.x()) < kMiddlePlane) {
        cost(i, j) *= 0.5;
        cost(j, i) *= 0.5;
      }
    }
  }
  return cost;
}

std::vector<int> anymate_parents(const std::vector<Eigen::Vector3d>& joints, Eigen::MatrixXd cost, int root) {
  const std::size_t n = joints.size();
  const double infinity = std::numeric_limits<double>::infinity();
  std::vector<int> parents(n, -1);
  std::vector<double> key(n, infinity);
  std::vector<char> in_tree(n, 0);
  key[static_cast<std::size_t>(root)] = 0.0;
  for (std::size_t added = 0; added < n; ++added) {
    std::size_t u = n;
    double least = infinity;
    for (std::size_t v = 0; v < n; ++v) {
      if (!in_tree[v] && key[v] < least) {
        least = key[v];
        u = v;
      }
    }
    if (u == n) break;  // what is left cannot be reached
    in_tree[u] = 1;
    const auto row = static_cast<Eigen::Index>(u);
    if (parents[u] >= 0) {
      const Eigen::Vector3d back = direction(joints[u], joints[static_cast<std::size_t>(parents[u])]);
      for (std::size_t v = 0; v < n; ++v) {
        const double fold = std::max(0.0, back.dot(direction(joints[u], joints[v])));
        const double penalty = kFoldBack * fold * fold + 1.0;
        const auto column = static_cast<Eigen::Index>(v);
        cost(row, column) += penalty;
        if (v != u) cost(column, row) += penalty;
      }
    }
    for (std::size_t v = 0; v < n; ++v) {
      const double edge = cost(row, static_cast<Eigen::Index>(v));
      if (!in_tree[v] && edge > 0.0 && edge < key[v]) {
        key[v] = edge;
        parents[v] = static_cast<int>(u);
      }
    }
  }
  return parents;
}

AnymateTree grow_anymate_tree(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents,
                              const AnymateOccupancy& inside) {
  AnymateTree skeleton;
  skeleton.cost = anymate_bone_costs(joints, parents, inside);
  for (int j = 1; j < static_cast<int>(joints.size()); ++j) {
    if (parents(j, j) > parents(skeleton.root, skeleton.root)) skeleton.root = j;
  }
  skeleton.tree = {joints, anymate_parents(joints, skeleton.cost, skeleton.root)};
  return skeleton;
}

}  // namespace anigen::eval
