#include "anigen/motions/figure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "anigen/asset/joint_side.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/geometry/nearest_point.h"

namespace anigen::motions {

namespace {

using Eigen::Vector3d;
using Affinity = std::map<std::pair<int, int>, double>;

constexpr double kNoMass = 1e-4;  ///< share of the surface below which a joint counts as one that moves nothing

void set_children(Figure& figure) {
  figure.children.assign(figure.joints(), {});
  for (std::size_t j = 0; j < figure.joints(); ++j) {
    if (figure.tree.parents[j] >= 0) figure.children[at(figure.tree.parents[j])].push_back(static_cast<int>(j));
  }
  figure.order = parents_first(figure.tree);
  figure.mass_below = figure.mass;
  for (auto j = figure.order.rbegin(); j != figure.order.rend(); ++j) {
    const int parent = figure.tree.parents[at(*j)];
    if (parent >= 0) figure.mass_below[at(parent)] += figure.mass_below[at(*j)];
  }
}

/// Vertices in one place count as one, since files split them at seams.
std::vector<int> welded(const std::vector<Eigen::Vector3f>& vertices) {
  std::map<std::array<float, 3>, int> first;
  std::vector<int> result;
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const Eigen::Vector3f& p = vertices[v];
    result.push_back(first.try_emplace({p.x(), p.y(), p.z()}, static_cast<int>(v)).first->second);
  }
  return result;
}

/// Distance of joints along the surface: how much of it two joints share, and along how many edges they meet.
Affinity shared_surface(const Asset& asset) {
  Affinity affinity;
  const auto add = [&](int a, int b, double value) {
    if (a != b) affinity[{std::min(a, b), std::max(a, b)}] += value;
  };
  const std::vector<int> place = welded(asset.mesh.vertices);
  std::vector<int> main(asset.mesh.vertices.size());
  for (std::size_t v = 0; v < main.size(); ++v) {
    const Influence* row = asset.skin.row(v);
    main[v] = row[0].joint;
    for (std::size_t i = 1; i < asset.skin.row_size(v); ++i) add(row[0].joint, row[i].joint, row[i].weight);
    add(main[v], main[at(place[v])], 0.5);
  }
  for (const Triangle& face : asset.mesh.faces) {
    for (std::size_t k = 0; k < 3; ++k) add(main[at(face[k])], main[at(face[(k + 1) % 3])], 0.5);
  }
  return affinity;
}

double nearest_distance(const Vector3d& point, const std::vector<Vector3d>& others) {
  double best = std::numeric_limits<double>::infinity();
  for (const Vector3d& other : others) best = std::min(best, (other - point).squaredNorm());
  return std::sqrt(best);
}

/// A parent that only groups: it moves nothing, and stands at the root, at the ground or far from the joint.
bool is_mere_group(const Figure& figure, int joint) {
  const int parent = figure.tree.parents[at(joint)];
  if (figure.mass[at(parent)] > 0.005) return false;
  const Vector3d &here = figure.tree.positions[at(joint)], there = figure.tree.positions[at(parent)];
  const bool is_root = figure.tree.parents[at(parent)] < 0;
  const bool on_ground = there.z() < figure.box.low.z() + 0.1 * figure.height;
  return is_root || on_ground || (here - there).norm() > 0.25 * figure.size;
}

/// Gives feet that hang on a group of controls, with no surface between, the shin as parent.
void mend_parents(Figure& figure, const Affinity& affinity) {
  for (std::size_t j = 0; j < figure.joints(); ++j) {
    const int joint = static_cast<int>(j), parent = figure.tree.parents[j];
    if (parent < 0 || figure.mass_below[j] < kNoMass || !is_mere_group(figure, joint)) continue;
    const std::vector<int>& siblings = figure.children[at(parent)];
    const int main = *std::max_element(siblings.begin(), siblings.end(), [&](int a, int b) {
      return figure.mass_below[at(a)] < figure.mass_below[at(b)];
    });
    if (main == joint || figure.mass_below[j] > 0.5 * figure.mass_below[at(main)]) continue;
    const std::vector<int> own = figure.subtree(joint);
    const auto parts = std::count_if(own.begin(), own.end(), [&](int k) { return figure.mass[at(k)] > kNoMass; });
    if (parts > (figure.tree.parents[at(parent)] < 0 ? 4 : 2)) continue;  // a whole limb, not the end of one
    int best = -1;
    double most = 0.0;
    const double reach = 0.3 * figure.size;
    for (std::size_t k = 0; k < figure.joints(); ++k) {
      const int other = static_cast<int>(k);
      if (figure.mass[k] < kNoMass || figure.is_below(other, joint) || other == parent) continue;
      double shared = 0.0;
      for (const int part : own) {
        const auto found = affinity.find({std::min(part, other), std::max(part, other)});
        if (found != affinity.end()) shared += found->second;
      }
      const bool near = nearest_distance(figure.tree.positions[j], figure.surface[k]) < reach;
      if (near && shared > most) std::tie(best, most) = std::pair(other, shared);
    }
    if (best < 0) {  // parts that touch without sharing vertices, as those of machines
      double nearest = 0.04 * figure.size;
      for (std::size_t k = 0; k < figure.joints(); ++k) {
        const int other = static_cast<int>(k);
        if (figure.mass[k] < kNoMass || figure.is_below(other, joint) || other == parent) continue;
        const double distance = nearest_distance(figure.tree.positions[j], figure.surface[k]);
        if (distance < nearest) std::tie(best, nearest) = std::pair(other, distance);
      }
    }
    if (best < 0) continue;
    for (bool nearer = true; nearer;) {  // the chain goes on as far as it comes nearer
      nearer = false;
      for (const int child : figure.children[at(best)]) {
        const auto apart = [&](int k) {
          return (figure.tree.positions[at(k)] - figure.tree.positions[j]).squaredNorm();
        };
        if (child == joint || figure.mass_below[at(child)] < kNoMass || !(apart(child) < apart(best))) continue;
        best = child;
        nearer = true;
        break;
      }
    }
    if (figure.is_below(best, joint)) continue;
    figure.tree.parents[j] = best;
    set_children(figure);
  }
}

/// Joints that names tell to be left and right of each other: those that only the side tells apart, else those that a
/// number at the end tells apart, too. Names that several joints have tell nothing.
std::vector<std::array<int, 2>> named_pairs(const std::vector<std::string>& names) {
  constexpr int kNone = -1, kSeveral = -2;
  std::vector<SidedName> sided;
  for (const std::string& name : names) sided.push_back(side_of_name(name));
  std::vector<std::array<int, 2>> pairs;
  std::vector<char> is_paired(names.size(), 0);
  for (std::string SidedName::*key : {&SidedName::rest, &SidedName::stem}) {
    std::map<std::string, std::array<int, 2>> by_key;
    for (std::size_t j = 0; j < names.size(); ++j) {
      if (sided[j].side == 0 || is_paired[j] != 0) continue;
      auto& pair = by_key.try_emplace(sided[j].*key, std::array<int, 2>{kNone, kNone}).first->second;
      int& place = pair[sided[j].side > 0 ? 0 : 1];
      place = place == kNone ? static_cast<int>(j) : kSeveral;
    }
    for (const auto& [name, pair] : by_key) {
      if (pair[0] < 0 || pair[1] < 0) continue;
      pairs.push_back(pair);
      is_paired[at(pair[0])] = is_paired[at(pair[1])] = 1;
    }
  }
  return pairs;
}

/// The nearest joint at the mirrored place, if both are each other's; the joint itself on the plane.
void set_mirrors(Figure& figure) {
  const std::size_t count = figure.joints();
  figure.mirror.assign(count, -1);
  for (const auto& pair : named_pairs(figure.names)) {
    figure.mirror[at(pair[0])] = pair[1];
    figure.mirror[at(pair[1])] = pair[0];
  }
  const auto mirrored = [&](const Vector3d& p) {
    return Vector3d(p + 2.0 * (figure.middle - figure.left.dot(p)) * figure.left);
  };
  const auto nearest = [&](std::size_t j) {
    const Vector3d place = mirrored(figure.tree.positions[j]);
    int best = -1;
    double least = 0.05 * figure.size;
    for (std::size_t k = 0; k < count; ++k) {
      if (figure.mirror[k] >= 0 && figure.mirror[k] != static_cast<int>(k)) continue;
      double distance = (figure.tree.positions[k] - place).norm();
      if (k == j) distance -= 1e-3 * figure.size;  // of joints in one place the joint itself
      if (distance < least) std::tie(best, least) = std::pair(static_cast<int>(k), distance);
    }
    return best;
  };
  std::vector<int> wanted(count, -1);
  for (std::size_t j = 0; j < count; ++j) {
    if (figure.mirror[j] < 0) wanted[j] = nearest(j);
  }
  for (std::size_t j = 0; j < count; ++j) {
    if (wanted[j] >= 0 && wanted[at(wanted[j])] == static_cast<int>(j)) figure.mirror[j] = wanted[j];
  }
}

/// Mean distance of mirrored joints and surface points from their nearest, in sizes.
double asymmetry(const Figure& figure, const Vector3d& left, double middle, const std::vector<Vector3d>& points,
                 const geometry::PointIndex& index) {
  double sum = 0.0;
  for (const Vector3d& p : points) sum += std::sqrt(index.nearest(p + 2.0 * (middle - left.dot(p)) * left).squared);
  return sum / static_cast<double>(points.size()) / figure.size;
}

/// Evidence for a direction being the front: toes, and what is called head and tail.
double front_evidence(const Figure& figure, const Vector3d& forward) {
  double toes = 0.0, ends = 0.0;
  const double near_ground = figure.box.low.z() + 0.08 * figure.height;
  for (std::size_t j = 0; j < figure.joints(); ++j) {
    if (figure.surface[j].empty()) continue;
    Vector3d centre = Vector3d::Zero();
    double lowest = std::numeric_limits<double>::infinity();
    for (const Vector3d& p : figure.surface[j]) {
      centre += p / static_cast<double>(figure.surface[j].size());
      lowest = std::min(lowest, p.z());
    }
    if (lowest < near_ground && figure.tree.positions[j].z() < near_ground + 0.17 * figure.height) {
      int ankle = static_cast<int>(j);  // feet of several joints are measured from above the ground
      while (figure.tree.positions[at(ankle)].z() < figure.box.low.z() + 0.05 * figure.height &&
             figure.tree.parents[at(ankle)] >= 0)
        ankle = figure.tree.parents[at(ankle)];
      if ((centre - figure.tree.positions[at(ankle)]).norm() < 0.25 * figure.height)
        toes += forward.dot(centre - figure.tree.positions[at(ankle)]) / figure.size;
    }
    const double along = forward.dot(centre - figure.box.center()) / figure.size;
    if (name_says(figure.names[j], {"head", "jaw", "nose", "beak", "snout"})) ends += along;
    if (name_says(figure.names[j], {"tail"})) ends -= along;
  }
  return std::clamp(toes / 0.05, -0.7, 0.7) + std::clamp(ends / 0.15, -1.0, 1.0);
}

void set_directions(Figure& figure) {
  const Vector3d up = Vector3d::UnitZ();
  Vector3d sum = Vector3d::Zero();
  double apart = 0.0, middle = 0.0;
  int pairs = 0;
  for (const auto& pair : named_pairs(figure.names)) {
    Vector3d across = figure.tree.positions[at(pair[0])] - figure.tree.positions[at(pair[1])];
    across.z() = 0.0;
    if (across.norm() < 0.02 * figure.size) continue;
    sum += across;
    apart += across.norm();
    ++pairs;
  }
  const bool is_named = pairs >= 2 && sum.norm() > 0.8 * apart;
  std::vector<Vector3d> candidates = {Vector3d::UnitX(), Vector3d::UnitY()};
  if (is_named) {
    Vector3d across = sum.normalized();
    for (const Vector3d& axis : candidates) {  // noise of a pose is no other direction
      if (std::abs(axis.dot(across)) > 0.98) across = axis.dot(across) > 0 ? axis : Vector3d(-axis);
    }
    candidates = {across};
  }
  std::vector<Vector3d> points = figure.tree.positions;
  std::size_t all = 0;
  for (const auto& part : figure.surface) all += part.size();
  const std::size_t step = std::max<std::size_t>(1, all / 600);
  std::size_t counter = 0;
  std::vector<Vector3d> everything = figure.tree.positions;
  for (const auto& part : figure.surface) {
    for (const Vector3d& p : part) {
      everything.push_back(p);
      if (counter++ % step == 0) points.push_back(p);
    }
  }
  const geometry::PointIndex index(everything);
  double best = std::numeric_limits<double>::infinity();
  for (const Vector3d& left : candidates) {
    std::vector<double> middles = {left.dot(figure.box.center()), 0.0};
    for (const int j : figure.order) {
      if (figure.mass_below[at(j)] > 0.5) middles.push_back(left.dot(figure.tree.positions[at(j)]));
    }
    for (const double place : middles) {
      double score = asymmetry(figure, left, place, points, index);
      if (left.y() == 1.0 && !is_named) score = 2.0 * score + 0.01;  // files face -Y unless there is reason to doubt
      if (score < best - 1e-9) std::tie(best, figure.left, middle) = std::tuple(score, left, place);
    }
  }
  Vector3d forward = figure.left.cross(up);
  double evidence = front_evidence(figure, forward) + (is_named ? 0.8 : 0.0);
  evidence += 1.0 * forward.dot(-Vector3d::UnitY());
  if (evidence < 0.0) {
    figure.left = -figure.left;
    middle = -middle;
    forward = -forward;
  }
  figure.forward = forward;
  figure.middle = middle;
}

void finish(Figure& figure) {
  set_directions(figure);
  set_mirrors(figure);
}

}  // namespace

bool Figure::is_below(int joint, int above) const {
  for (int j = joint; j >= 0; j = tree.parents[at(j)]) {
    if (j == above) return true;
  }
  return false;
}

std::vector<int> Figure::subtree(int joint) const {
  std::vector<int> result = {joint};
  for (std::size_t i = 0; i < result.size(); ++i) {
    for (const int child : children[at(result[i])]) result.push_back(child);
  }
  return result;
}

std::vector<int> Figure::path(int from, int to) const {
  std::vector<int> up, down;
  for (int j = from; j >= 0; j = tree.parents[at(j)]) {
    up.push_back(j);
    if (is_below(to, j)) break;
  }
  for (int j = to; j >= 0 && j != up.back(); j = tree.parents[at(j)]) down.push_back(j);
  up.insert(up.end(), down.rbegin(), down.rend());
  return up;
}

double Figure::lowest(const std::vector<int>& joints) const {
  double result = std::numeric_limits<double>::infinity();
  for (const int j : joints) {
    for (const Vector3d& p : surface[at(j)]) result = std::min(result, p.z());
  }
  return result;
}

bool name_says(const std::string& name, const std::vector<std::string>& words) {
  const std::string lower = lower_case(name);
  return std::any_of(words.begin(), words.end(),
                     [&](const std::string& word) { return lower.find(word) != std::string::npos; });
}

Figure figure_of(const Asset& asset) {
  const auto refuse = [&](const std::string& problem) { throw InputError(asset.name, "", problem); };
  if (asset.mesh.vertices.empty()) refuse("there is no mesh to move");
  if (asset.skeleton.size() == 0) refuse("there is no skeleton to move; anigen-rig makes one");
  if (asset.skin.rows() == 0) refuse("there are no skin weights; anigen-rig makes some");
  const std::vector<std::string> findings = validate(asset, 1);
  if (!findings.empty()) refuse("asset is not sound: " + findings.front());
  Figure figure;
  figure.tree = joint_tree(asset.skeleton);
  figure.names = asset.skeleton.names;
  figure.surface.resize(figure.joints());
  figure.mass.assign(figure.joints(), 0.0);
  figure.box = bounding_box(asset.mesh.vertices);
  figure.height = std::max(figure.box.high.z() - figure.box.low.z(), 1e-3 * figure.box.longest_side());
  figure.size = figure.box.longest_side();
  if (!(figure.size > 0.0)) refuse("the mesh has no extent");
  std::vector<double> area(asset.mesh.vertices.size(), 0.0);
  double all = 0.0;
  for (const Triangle& face : asset.mesh.faces) {
    const double part = area_vector(asset.mesh.vertices, face).norm();
    for (const std::int32_t v : face) area[at(v)] += part;
    all += 3.0 * part;
  }
  for (std::size_t v = 0; v < area.size(); ++v) {
    const Influence* row = asset.skin.row(v);
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i)
      figure.mass[at(row[i].joint)] += all > 0.0 ? area[v] / all * row[i].weight : 0.0;
    figure.surface[at(row[0].joint)].push_back(asset.mesh.vertices[v].cast<double>());
  }
  set_children(figure);
  mend_parents(figure, shared_surface(asset));
  finish(figure);
  return figure;
}

Figure figure_of(const JointTree& tree, const std::vector<std::string>& names) {
  check(tree, "skeleton");
  Figure figure;
  figure.tree = connected(tree);
  figure.names = names;
  figure.names.resize(tree.size());
  figure.surface.resize(tree.size());
  figure.mass.assign(tree.size(), 0.0);
  for (const Vector3d& p : tree.positions) figure.box.extend(p);
  figure.size = figure.box.longest_side();
  figure.height = std::max(figure.box.high.z() - figure.box.low.z(), 1e-3 * figure.size);
  if (!(figure.size > 0.0)) throw InputError("skeleton", "", "all joints are in one place");
  double all = 0.0;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const int parent = figure.tree.parents[j];
    figure.surface[j].push_back(tree.positions[j]);
    if (parent < 0) continue;
    const double length = (tree.positions[j] - tree.positions[at(parent)]).norm();
    figure.mass[at(parent)] += 0.5 * length;
    figure.mass[j] += 0.5 * length;
    all += length;
  }
  for (double& mass : figure.mass) mass /= all;
  set_children(figure);
  finish(figure);
  return figure;
}

}  // namespace anigen::motions
