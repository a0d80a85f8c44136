#include "anigen/eval/motion/motion_plan.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/eval/motion/motion.h"
#include "anigen/eval/skeleton/joint_ties.h"
#include "anigen/eval/transport/exact_transport.h"

namespace anigen::eval {
namespace {

constexpr double kPiece = 0.05;  ///< longest piece of a bone, and mass of a joint without bones
constexpr double kMostPieces = 400;
constexpr double kTieWeight = 1e-9;  ///< far below any distance that matters

struct Piece {
  Eigen::Vector3d place;
  double mass;
  int joint;  ///< that moves it
};

double length_of(const io::JointTree& tree, std::size_t j) {
  return tree.parents[j] < 0 ? 0.0 : (tree.positions[j] - tree.positions[at(tree.parents[j])]).norm();
}

/// @param unit a length that masses are counted in
std::vector<Piece> pieces_of(const io::JointTree& tree, double unit) {
  double total = 0.0;
  for (std::size_t j = 0; j < tree.size(); ++j) total += length_of(tree, j) / unit;
  const double longest = std::max(kPiece, total / kMostPieces);
  std::vector<Piece> pieces;
  std::vector<bool> has_bone(tree.size(), false);
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const double length = length_of(tree, j) / unit;
    if (!(length > kTieWeight)) continue;
    const int parent = tree.parents[j];
    has_bone[at(parent)] = true;
    const Eigen::Vector3d from = tree.positions[at(parent)], way = tree.positions[j] - from;
    const int count = static_cast<int>(std::ceil(length / longest * (1.0 - 1e-9)));
    for (int i = 0; i < count; ++i) pieces.push_back({from + (i + 0.5) / count * way, length / count, parent});
  }
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (!has_bone[j]) pieces.push_back({tree.positions[j], kPiece, static_cast<int>(j)});
  }
  const auto place = [&tree](const Piece& piece) {
    const Eigen::Vector3d &p = piece.place, &q = tree.positions[at(piece.joint)];
    return std::make_tuple(p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), piece.mass);
  };
  std::stable_sort(pieces.begin(), pieces.end(), [&](const Piece& a, const Piece& b) { return place(a) < place(b); });
  return pieces;
}

/// The pieces' masses and, last, as much as the other side has: what is matched with nothing.
Eigen::VectorXd masses(const std::vector<Piece>& pieces, const std::vector<Piece>& others) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(pieces.size()) + 1);
  for (std::size_t i = 0; i < pieces.size(); ++i) result[static_cast<Eigen::Index>(i)] = pieces[i].mass;
  double spare = 0.0;
  for (const Piece& other : others) spare += other.mass;
  result[result.size() - 1] = spare;
  return result;
}

}  // namespace

Eigen::MatrixXd motion_plan(const io::JointTree& target, const io::JointTree& source, double reach) {
  check(target, "target skeleton");
  check(source, "source skeleton");
  if (!(reach > 0.0) || !std::isfinite(reach)) throw InputError("", "reach", "must be positive and finite");
  const double unit = size_of(source);
  const std::vector<Piece> rows = pieces_of(target, unit), columns = pieces_of(source, unit);
  const Eigen::MatrixXd ties = joint_ties(target, source);

  const auto n = static_cast<Eigen::Index>(rows.size()), m = static_cast<Eigen::Index>(columns.size());
  Eigen::MatrixXd cost = Eigen::MatrixXd::Constant(n + 1, m + 1, 0.5 * reach * reach);
  cost(n, m) = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index k = 0; k < m; ++k) {
      const Piece &a = rows[static_cast<std::size_t>(i)], &b = columns[static_cast<std::size_t>(k)];
      // Beyond reach² nothing is matched; a smaller range leaves the solver more digits for ties.
      const double apart = std::min(((a.place - b.place) / unit).squaredNorm(), 2.0 * reach * reach);
      cost(i, k) = apart + kTieWeight * ties(a.joint, b.joint) / unit;
    }
  }
  // Lengths are no small multiples of one unit, which augmenting paths would need.
  const Eigen::MatrixXd plan =
      exact_transport(cost, masses(rows, columns), masses(columns, rows), ExactSolver::kNetworkSimplex).plan;

  Eigen::MatrixXd result =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(target.size()), static_cast<Eigen::Index>(source.size()));
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index k = 0; k < m; ++k)
      result(rows[static_cast<std::size_t>(i)].joint, columns[static_cast<std::size_t>(k)].joint) += plan(i, k);
  }
  return result;
}

}  // namespace anigen::eval
