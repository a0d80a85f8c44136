#include "anigen/rig/curve/propose_joints.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/curve_skeleton/contract_curve.h"
#include "anigen/rig/curve/curve_joints.h"
#include "anigen/rig/curve/curve_tree.h"
#include "anigen/rig/curve/solid_mesh.h"

namespace anigen::rig {
namespace {

constexpr std::size_t kLeastVertices = 60;  // of a piece
// A surface with handles cannot get below some vertices for each, and takes minutes to contract when it has thousands.
constexpr double kMostHandles = 50.0;
constexpr int kLeastResolution = 8;

void check_curve_options(const CurveSkeletonOptions& options) {
  const auto require = [](bool good, const char* name, const char* range) {
    if (!good) throw InputError("", std::string("curve_skeleton.") + name, std::string("must be ") + range);
  };
  require(options.resolution >= 8 && options.resolution <= 512, "resolution", "8 to 512");
  require(options.target_vertices >= 100 && options.target_vertices <= 100000, "target_vertices", "100 to 100000");
  require(options.most_pieces >= 1, "most_pieces", "1 or more");
  require(options.least_piece >= 0.0 && options.least_piece < 1.0, "least_piece", "0 or more and below 1");
  require(options.spur_radii >= 0.0 && std::isfinite(options.spur_radii), "spur_radii", "0 or more");
  require(options.spur_length >= 0.0 && std::isfinite(options.spur_length), "spur_length", "0 or more");
  require(options.join_radii >= 0.0 && std::isfinite(options.join_radii), "join_radii", "0 or more");
  require(options.bend > 0.0 && std::isfinite(options.bend), "bend", "positive");
  require(options.longest_bone > 0.0, "longest_bone", "positive");
  require(options.most_joints >= 2, "most_joints", "2 or more");
}

/// Curves of several pieces, side by side.
struct Curves {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> radii;
  std::vector<std::array<int, 2>> edges;
};

/// The radius of a point is the mean distance of the surface that went to it, or its depth where that is more: at forks
/// little of the surface arrives.
void add_curve(const ClosedMesh& piece, const SolidField& field, Curves& curves) {
  const curve_skeleton::CurveGraph graph = curve_skeleton::contract_curve(piece.vertices, piece.faces);
  const int before = static_cast<int>(curves.points.size());
  std::vector<double> sums(graph.points.size(), 0.0);
  std::vector<int> counts(graph.points.size(), 0);
  for (std::size_t v = 0; v < piece.vertices.size(); ++v) {
    const auto point = at(graph.point_of_vertex[v]);
    sums[point] += (piece.vertices[v] - graph.points[point]).norm();
    ++counts[point];
  }
  curves.points.insert(curves.points.end(), graph.points.begin(), graph.points.end());
  for (std::size_t p = 0; p < sums.size(); ++p) {
    curves.radii.push_back(std::max(counts[p] > 0 ? sums[p] / counts[p] : 0.0, -field.value(graph.points[p])));
  }
  for (const auto& [a, b] : graph.edges) curves.edges.push_back({before + a, before + b});
}

/// Handles of closed surfaces, all together: V − F / 2 is 2 for each piece, less 2 for each handle.
double handles_of(const std::vector<ClosedMesh>& pieces) {
  double handles = 0.0;
  for (const ClosedMesh& piece : pieces) {
    handles += 1.0 - 0.5 * (static_cast<double>(piece.vertices.size()) - 0.5 * static_cast<double>(piece.faces.size()));
  }
  return handles;
}

/// The pieces that count.
std::vector<ClosedMesh> large_pieces(const SolidField& field, const CurveSkeletonOptions& options) {
  std::vector<ClosedMesh> pieces = solid_pieces(field);
  if (pieces.empty()) throw InputError("", "mesh", "it encloses nothing that a cell of the grid would notice");
  double volume = 0.0;
  for (const ClosedMesh& piece : pieces) volume += piece.volume;
  if (pieces.size() > options.most_pieces) pieces.resize(options.most_pieces);
  while (pieces.size() > 1 && pieces.back().volume < options.least_piece * volume) pieces.pop_back();
  return pieces;
}

Curves contracted(const std::vector<ClosedMesh>& pieces, const SolidField& field, const CurveSkeletonOptions& options) {
  std::size_t vertices = 0;
  for (const ClosedMesh& piece : pieces) vertices += piece.vertices.size();
  Curves curves;
  for (const ClosedMesh& piece : pieces) {
    const std::size_t share = options.target_vertices * piece.vertices.size() / vertices;
    add_curve(with_fewer_vertices(piece, std::max(kLeastVertices, share)), field, curves);
  }
  return curves;
}

/// A lone point as a short line, since a skeleton without a bone moves nothing.
void require_line(CurveTree& tree, double length) {
  if (tree.size() != 1) return;
  tree.points.emplace_back(tree.points[0] + Eigen::Vector3d(0.0, 0.0, 0.5 * length));
  tree.points[0].z() -= 0.5 * length;
  tree.radii.push_back(tree.radii[0]);
  tree.neighbours = {{1}, {0}};
}

}  // namespace

Skeleton propose_curve_skeleton(const Mesh& mesh, const CurveSkeletonOptions& options) {
  check_curve_options(options);
  if (!curve_skeleton::can_contract()) {
    throw NotSupportedError("", "curve skeleton", "a build without CGAL (CMake option ANIGEN_WITH_CGAL)");
  }
  SolidField field = solid_field(mesh, 1.0, options.resolution);
  std::vector<ClosedMesh> pieces = large_pieces(field, options);
  for (int cells = options.resolution / 2; cells >= kLeastResolution && handles_of(pieces) > kMostHandles; cells /= 2) {
    field = solid_field(mesh, 1.0, cells);
    pieces = large_pieces(field, options);
  }
  const Curves curves = contracted(pieces, field, options);
  const CurveTree whole = curve_tree(curves.points, curves.radii, curves.edges);
  Skeleton skeleton;
  for (double coarser = 1.0;; coarser *= 1.25) {
    CurveTree tree = without_spurs(whole, options.spur_radii * coarser, options.spur_length * coarser);
    tree = with_joined_branches(std::move(tree), options.join_radii * coarser);
    require_line(tree, 0.02);
    CurveJointRules rules;
    rules.bend = options.bend * coarser;
    rules.longest_bone = options.longest_bone * coarser;
    skeleton = curve_joints(tree, rules);
    // At a hundredfold there are no spurs, branches or bends left, and two joints.
    if (skeleton.size() <= options.most_joints || coarser > 1e4) break;
  }
  std::vector<Eigen::Vector3d> joints = skeleton.positions();
  for (Eigen::Vector3d& joint : joints) joint = (joint - field.from_mesh.offset) / field.from_mesh.scale;
  return skeleton_from_joints(joints, skeleton.parents, skeleton.names);
}

}  // namespace anigen::rig
