#include "anigen/lint/weight_checks.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "anigen/asset/rigid_parts.h"
#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"
#include "anigen/core/table.h"
#include "anigen/geometry/nearest_point.h"

namespace anigen::lint {

namespace {

/// Sums of rows may be off by this: weights stored in 8 bits, four of them, round to 0.008 at most, in 16 bits to less
/// than 0.0001; a loss of 1 % cannot be seen.
constexpr double kSumTolerance = 0.01;
/// Influences per vertex that engines take without a second set of attributes (glTF 2.0, 3.7.2.1).
constexpr std::size_t kUsualInfluences = 4;
/// Weights up to this move a vertex by less than the eye sees, and painting leaves them everywhere.
constexpr double kIslandWeight = 0.05;
// Limits of islands, set on 130 rigs of artists. All have small pieces beside the main one, where a brush slipped: the
// farthest lie 0.27 of the size from it but within the joint's reach, or beyond its reach but within 0.13.
/// Distance of an island from its joint's bones, by the reach of the joint's largest piece, above which it is far.
constexpr double kIslandReach = 2.0;
/// Gap to the largest piece, by the size of the mesh, above which an island is far.
constexpr double kIslandGap = 0.15;
/// Weights from which on another shell's joint shows.
constexpr double kBleedWeight = 0.1;
/// A joint is foreign to a shell that holds no more than this share of its weight.
constexpr double kForeignShare = 0.05;
// Limits of bleed, set on the same rigs, where it reaches 0.20 of the size.
/// Distance to the foreign joint's bones, by the size of the mesh, above which it is far.
constexpr double kBleedDistance = 0.25;
/// Same by the distance to the nearest joint that has weights: belts and sleeves are as near to two joints.
constexpr double kBleedRatio = 3.0;

/// Share of a shell's weight in one joint from which on nothing of it bends to the eye.
constexpr double kRigidWeight = 0.99;

double part(std::size_t count, std::size_t all) {
  return all == 0 ? 0.0 : static_cast<double>(count) / static_cast<double>(all);
}

/// Vertices with one kind of defect, and the first or worst of them.
struct VertexCount {
  std::size_t count = 0, worst = 0;
  double badness = -1.0;

  void add(std::size_t vertex, double how_bad) {
    ++count;
    if (!(how_bad > badness)) return;
    badness = how_bad;
    worst = vertex;
  }
  void report(const Asset& asset, const std::string& code, Severity severity, const std::string& sentence,
              RigLint& lint) const {
    if (count == 0) return;
    const Place place{"vertex", worst, "", asset.mesh.vertices[worst].cast<double>()};
    lint.findings.push_back({code, severity, count, part(count, asset.mesh.vertices.size()), place, sentence});
  }
};

/// The places that a joint moves, as far as edges join them.
struct Piece {
  std::size_t joint = 0, shell = 0;
  double mass = 0.0;
  std::vector<std::size_t> places;
};

/// Pieces of all joints.
std::vector<Piece> pieces_of_joints(const WeldedRig& rig) {
  DisjointSets sets(rig.entries.size());
  const auto join = [&](std::size_t first, std::size_t second) {
    for (std::size_t a = rig.first_entry[first]; a < rig.first_entry[first + 1]; ++a) {
      for (std::size_t b = rig.first_entry[second]; b < rig.first_entry[second + 1]; ++b) {
        const bool one_joint = rig.entries[a].joint == rig.entries[b].joint;
        if (one_joint && std::min(rig.entries[a].weight, rig.entries[b].weight) > kIslandWeight) sets.join(a, b);
      }
    }
  };
  for (const MeshEdges::Edge& edge : rig.edges.all()) join(at(edge[0]), at(edge[1]));
  for (const auto& [first, second] : rig.twins) join(first, second);
  std::vector<Piece> pieces;
  std::vector<std::size_t> piece_of(rig.entries.size(), rig.entries.size());
  for (std::size_t e = 0; e < rig.entries.size(); ++e) {
    const WeldedRig::Entry& entry = rig.entries[e];
    if (!(entry.weight > kIslandWeight)) continue;
    std::size_t& piece = piece_of[sets.find(e)];
    if (piece == rig.entries.size()) {
      piece = pieces.size();
      pieces.push_back({at(entry.joint), rig.shells[at(entry.place)], 0.0, {}});
    }
    pieces[piece].mass += entry.weight;
    pieces[piece].places.push_back(at(entry.place));
  }
  return pieces;
}

/// Smallest and largest distance of a piece from the bones of its joint.
std::pair<double, double> distances(const WeldedRig& rig, const Piece& piece) {
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0.0;
  for (const std::size_t place : piece.places) {
    const double distance = rig.distance_to_bone(rig.places[place].cast<double>(), piece.joint);
    nearest = std::min(nearest, distance);
    farthest = std::max(farthest, distance);
  }
  return {nearest, farthest};
}

/// Smallest distance between points of two pieces.
double gap_between(const WeldedRig& rig, const Piece& main, const Piece& other) {
  std::vector<Eigen::Vector3d> points;
  for (const std::size_t place : main.places) points.push_back(rig.places[place].cast<double>());
  const geometry::PointIndex index(std::move(points));
  double nearest = std::numeric_limits<double>::max();
  for (const std::size_t place : other.places)
    nearest = std::min(nearest, index.nearest(rig.places[place].cast<double>()).squared);
  return std::sqrt(nearest);
}

void check_islands(const WeldedRig& rig, RigLint& lint) {
  const std::vector<Piece> pieces = pieces_of_joints(rig);
  std::map<std::pair<std::size_t, std::size_t>, std::vector<std::size_t>> of_shell;  // by joint and shell
  for (std::size_t i = 0; i < pieces.size(); ++i) of_shell[{pieces[i].joint, pieces[i].shell}].push_back(i);
  std::size_t small = 0, far = 0, far_places = 0, joint_of_worst = 0, place_of_worst = 0;
  double worst_gap = 0.0;
  for (const auto& [key, list] : of_shell) {
    if (list.size() < 2) continue;
    const std::size_t main = *std::max_element(
        list.begin(), list.end(), [&](std::size_t a, std::size_t b) { return pieces[a].mass < pieces[b].mass; });
    const double reach = distances(rig, pieces[main]).second;
    for (const std::size_t i : list) {
      if (i == main) continue;
      ++small;
      if (!(distances(rig, pieces[i]).first > kIslandReach * reach)) continue;
      const double gap = gap_between(rig, pieces[main], pieces[i]) / rig.size;
      if (!(gap > kIslandGap)) continue;
      ++far;
      far_places += pieces[i].places.size();
      if (!(gap > worst_gap)) continue;
      worst_gap = gap;
      joint_of_worst = pieces[i].joint;
      place_of_worst = pieces[i].places.front();
    }
  }
  lint.figures["weight_islands"] = small;
  lint.figures["far_weight_islands"] = far;
  if (far == 0) return;
  lint.findings.push_back({"weight-islands", Severity::kWarning, far_places, part(far_places, rig.places.size()),
                           rig.place_of_vertex(place_of_worst, joint_of_worst),
                           std::to_string(far) + (far == 1 ? " piece" : " pieces") +
                               " of the surface far from a joint move with it, although nothing between does; "
                               "the worst with " +
                               rig.joint_name(joint_of_worst)});
}

/// True where no joint above this one has weights: the root of what moves, to which files bind everything loose.
bool is_top(const WeldedRig& rig, std::size_t joint) {
  for (int above = rig.asset().skeleton.parents[joint]; above >= 0; above = rig.asset().skeleton.parents[at(above)]) {
    if (rig.weights[at(above)] > 0.0) return false;
  }
  return true;
}

void check_bleed(const WeldedRig& rig, RigLint& lint) {
  std::map<std::pair<std::size_t, std::size_t>, double> on_shell;  // by joint and shell
  for (const WeldedRig::Entry& entry : rig.entries)
    on_shell[{at(entry.joint), rig.shells[at(entry.place)]}] += entry.weight;
  std::vector<bool> top;
  for (std::size_t j = 0; j < rig.joint_count(); ++j) top.push_back(is_top(rig, j));
  std::size_t count = 0, worst_place = 0, worst_joint = 0;
  double farthest = 0.0;
  for (const WeldedRig::Entry& entry : rig.entries) {
    const std::size_t joint = at(entry.joint), place = at(entry.place);
    if (entry.weight < kBleedWeight || top[joint]) continue;
    if (on_shell.at({joint, rig.shells[place]}) > kForeignShare * rig.weights[joint]) continue;
    const Eigen::Vector3d point = rig.places[place].cast<double>();
    const double distance = rig.distance_to_bone(point, joint);
    if (!(distance > kBleedDistance * rig.size)) continue;
    double nearest = distance;
    for (std::size_t other = 0; other < rig.joint_count(); ++other) {
      if (rig.weights[other] > 0.0) nearest = std::min(nearest, rig.distance_to_bone(point, other));
    }
    if (!(distance > kBleedRatio * nearest)) continue;
    ++count;
    if (!(distance > farthest)) continue;
    farthest = distance;
    worst_place = place;
    worst_joint = joint;
  }
  lint.figures["shell_bleed_share"] = part(count, rig.places.size());
  if (count == 0) return;
  lint.findings.push_back(
      {"shell-bleed", Severity::kWarning, count, part(count, rig.places.size()),
       rig.place_of_vertex(worst_place, worst_joint),
       "vertices move with a joint of another shell, far from them; the farthest with " + rig.joint_name(worst_joint)});
}

/// Shells that follow one joint alone, as the parts of a machine do.
void count_rigid_shells(const WeldedRig& rig, RigLint& lint) {
  const RigidSkin parts = rigid_parts(rig.asset().mesh, rig.asset().skin, kRigidWeight);
  std::size_t rigid = 0;
  double area = 0.0;
  for (const RigidPart& one : parts.parts) {
    if (!one.rigid) continue;
    ++rigid;
    area += one.area;
  }
  lint.figures["rigid_shell_share"] = part(rigid, parts.parts.size());
  lint.figures["rigid_area_share"] = area;
}

}  // namespace

bool rows_are_readable(const SkinWeights& skin) {
  return !skin.offsets.empty() && skin.offsets.front() == 0 && skin.offsets.back() == skin.influences.size() &&
         std::is_sorted(skin.offsets.begin(), skin.offsets.end());
}

void check_rows(const Asset& asset, RigLint& lint) {
  VertexCount unweighted, bad, sums, many;
  double lowest = 1.0, highest = 1.0;
  std::size_t most = 0;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    double sum = 0.0, wrong = 0.0;
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      const bool known = influence.joint >= 0 && at(influence.joint) < asset.skeleton.size();
      if (!known || !std::isfinite(influence.weight))
        wrong = std::numeric_limits<double>::infinity();
      else if (influence.weight < 0.0f)
        wrong = std::max(wrong, -static_cast<double>(influence.weight));
      else
        sum += static_cast<double>(influence.weight);
    }
    most = std::max(most, asset.skin.row_size(v));
    if (asset.skin.row_size(v) > kUsualInfluences) many.add(v, static_cast<double>(asset.skin.row_size(v)));
    if (wrong > 0.0) {
      bad.add(v, wrong);
    } else if (!(sum > 0.0)) {
      unweighted.add(v, 0.0);
    } else {
      lowest = std::min(lowest, sum);
      highest = std::max(highest, sum);
      if (std::abs(sum - 1.0) > kSumTolerance) sums.add(v, std::abs(sum - 1.0));
    }
  }
  lint.figures["unweighted_share"] = part(unweighted.count, asset.skin.rows());
  lint.figures["most_influences"] = most;
  unweighted.report(asset, "unweighted-vertices", Severity::kError, "vertices without weights stay where they are",
                    lint);
  bad.report(asset, "bad-weights", Severity::kError,
             "vertices have a weight that is negative, not a number, or of a joint that does not exist", lint);
  sums.report(asset, "weight-sums", Severity::kError,
              "weights do not sum to 1: sums go from " + significant(lowest, 3) + " to " + significant(highest, 3),
              lint);
  many.report(asset, "many-influences", Severity::kNote,
              "vertices have more than " + std::to_string(kUsualInfluences) + " joints, up to " + std::to_string(most) +
                  "; many engines keep the heaviest",
              lint);
}

void check_surface_weights(const WeldedRig& rig, RigLint& lint) {
  check_islands(rig, lint);
  check_bleed(rig, lint);
  count_rigid_shells(rig, lint);
}

}  // namespace anigen::lint
