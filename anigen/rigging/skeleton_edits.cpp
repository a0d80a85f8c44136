#include "anigen/rigging/skeleton_edits.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <utility>
#include <vector>

#include "anigen/asset/joint_side.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/process.h"
#include "anigen/geometry/bones.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::rigging {

namespace {

using Points = std::vector<Eigen::Vector3d>;

constexpr double kPairNear = 0.1;     ///< share of the size: a joint this near to another's image is its counterpart
constexpr double kMiddleNear = 0.04;  ///< likewise of its own image
constexpr double kUnreached = 0.04, kUnreachedRadii = 1.5, kLeastBranch = 0.06;
constexpr double kStraightCost = 0.1;  ///< per length of the shorter bone: of equally straight joints the close ones go

/// A skeleton while it is edited: parents first.
struct Joints {
  Points positions;
  std::vector<int> parents;
  std::vector<std::string> names;
  bool named_by_place = false;

  explicit Joints(const Skeleton& skeleton)
      : positions(skeleton.positions()),
        parents(skeleton.parents),
        names(skeleton.names),
        named_by_place(skeleton.names == joint_names(positions, parents)) {}

  std::size_t size() const { return parents.size(); }

  std::vector<std::vector<int>> children() const {
    std::vector<std::vector<int>> lists(size());
    for (std::size_t j = 1; j < size(); ++j) lists[at(parents[j])].push_back(static_cast<int>(j));
    return lists;
  }

  Skeleton skeleton() const {
    return skeleton_from_joints(positions, parents, named_by_place ? joint_names(positions, parents) : names);
  }

  /// Children of a removed root go to its first child.
  void remove(int joint) {
    const int heir = joint == 0 ? 1 : parents[at(joint)];
    for (int& parent : parents) {
      if (parent == joint) parent = heir;
    }
    if (joint == 0) parents[1] = -1;
    positions.erase(positions.begin() + joint);
    parents.erase(parents.begin() + joint);
    names.erase(names.begin() + joint);
    for (int& parent : parents) parent -= parent > joint ? 1 : 0;
  }

  /// Halves the bone that ends at a joint, whose index grows by one.
  void halve(int joint) {
    const auto place = static_cast<std::ptrdiff_t>(joint);
    const int parent = parents[at(joint)];
    const Eigen::Vector3d middle = 0.5 * (positions[at(joint)] + positions[at(parent)]);
    std::string name = "mid_" + names[at(joint)];
    while (std::find(names.begin(), names.end(), name) != names.end()) name = "mid_" + name;
    for (int& other : parents) other += other >= joint ? 1 : 0;
    positions.insert(positions.begin() + place, middle);
    parents.insert(parents.begin() + place, parent);
    names.insert(names.begin() + place, name);
    parents[at(joint) + 1] = joint;
  }
};

/// Length that would be lost without a joint, in the skeleton's unit; infinite for a root of several branches.
double worth(const Joints& joints, const std::vector<std::vector<int>>& children, int joint) {
  const std::vector<int>& below = children[at(joint)];
  const Eigen::Vector3d& place = joints.positions[at(joint)];
  const int above = joints.parents[at(joint)];
  if (above < 0) return below.size() == 1 ? (joints.positions[at(below[0])] - place).norm() : INFINITY;
  const double length = (place - joints.positions[at(above)]).norm();
  if (below.size() != 1) return length;
  const Eigen::Vector3d& next = joints.positions[at(below[0])];
  const double bend = geometry::distance_to_segment(place, joints.positions[at(above)], next);
  return bend + kStraightCost * std::min(length, (next - place).norm());
}

/// The name with the other side's word; with a mark where it names no side.
std::string other_side(const std::string& name, const std::vector<std::string>& taken) {
  static const std::pair<const char*, const char*> kWords[] = {{"Left", "Right"}, {"left", "right"}, {"LEFT", "RIGHT"},
                                                               {"_L", "_R"},      {"_l", "_r"},      {".L", ".R"},
                                                               {".l", ".r"},      {"L_", "R_"},      {"l_", "r_"}};
  const auto is_free = [&](const std::string& text) {
    return std::find(taken.begin(), taken.end(), text) == taken.end();
  };
  const SidedName sided = side_of_name(name);
  for (const auto& [left, right] : kWords) {
    if (sided.side == 0) break;
    const std::string from = sided.side > 0 ? left : right, to = sided.side > 0 ? right : left;
    const std::size_t found = name.rfind(from);
    if (found == std::string::npos) continue;
    std::string swapped = name;
    swapped.replace(found, from.size(), to);
    const SidedName other = side_of_name(swapped);
    if (other.side == -sided.side && other.rest == sided.rest && is_free(swapped)) return swapped;
  }
  std::string marked = name + "_mirrored";
  while (!is_free(marked)) marked += "_2";
  return marked;
}

/// Counterparts of joints across a plane, found from the root on: only children of counterparts are counterparts.
class Counterparts {
 public:
  Counterparts(const Joints& joints, double middle, double size)
      : joints_(joints), children_(joints.children()), middle_(middle), size_(size), of_(joints.size(), -1) {
    of_[0] = 0;
    for (std::size_t j = 0; j < joints.size(); ++j) {
      const int other = of_[j];
      if (other >= static_cast<int>(j)) match(children_[j], children_[at(other)], other == static_cast<int>(j));
    }
  }

  Eigen::Vector3d image(int joint) const {
    Eigen::Vector3d place = joints_.positions[at(joint)];
    place.x() = 2.0 * middle_ - place.x();
    return place;
  }
  /// [J]: itself in the middle, -1 without one
  const std::vector<int>& of() const { return of_; }

 private:
  /// Nearest pairs first. The only child of a joint in the middle is there, too: a tail stays one, however bent.
  void match(const std::vector<int>& left, const std::vector<int>& right, bool is_same) {
    if (is_same && left.size() == 1) {
      of_[at(left[0])] = left[0];
      return;
    }
    std::vector<std::pair<double, std::pair<int, int>>> pairs;
    for (const int a : left) {
      for (const int b : right) {
        if (is_same && b < a) continue;
        const double apart = (image(a) - joints_.positions[at(b)]).norm();
        if (apart <= (a == b ? 2.0 * kMiddleNear : kPairNear) * size_) pairs.push_back({apart, {a, b}});
      }
    }
    std::sort(pairs.begin(), pairs.end());
    for (const auto& [apart, pair] : pairs) {
      const auto [a, b] = pair;
      if (of_[at(a)] >= 0 || of_[at(b)] >= 0) continue;
      of_[at(a)] = b;
      of_[at(b)] = a;
    }
  }

  const Joints& joints_;
  std::vector<std::vector<int>> children_;
  double middle_, size_;
  std::vector<int> of_;
};

}  // namespace

Skeleton with_joint_count(const Skeleton& skeleton, std::size_t count) {
  if (count == 0) throw InputError("", "joints", "a skeleton has one joint at least");
  Joints joints(skeleton);
  while (joints.size() > count) {
    throw_if_interrupted();
    const std::vector<std::vector<int>> children = joints.children();
    const std::vector<int> mirrored = mirrored_joints(joints.positions, joints.parents);
    const bool pairs_allowed = joints.size() - count >= 2;
    const auto least = [&](bool with_pairs) {
      int best = -1;
      double least_worth = INFINITY;
      for (std::size_t j = 0; j < joints.size(); ++j) {
        if (!with_pairs && mirrored[j] >= 0) continue;
        const double lost = worth(joints, children, static_cast<int>(j));
        if (lost < least_worth) {
          least_worth = lost;
          best = static_cast<int>(j);
        }
      }
      return best;
    };
    int removed = least(pairs_allowed);
    if (removed < 0) removed = least(true);
    if (removed < 0) removed = static_cast<int>(joints.size()) - 1;
    const int other = pairs_allowed ? mirrored[at(removed)] : -1;
    joints.remove(std::max(removed, other));
    if (other >= 0) joints.remove(std::min(removed, other));
  }
  while (joints.size() < count) {
    throw_if_interrupted();
    if (joints.size() == 1) throw InputError("", "joints", "a skeleton of one joint has no bone to halve");
    const std::vector<int> mirrored = mirrored_joints(joints.positions, joints.parents);
    const bool pairs_allowed = count - joints.size() >= 2;
    const auto longest = [&](bool with_pairs) {
      int best = -1;
      double length = -1.0;
      for (std::size_t j = 1; j < joints.size(); ++j) {
        if (!with_pairs && mirrored[j] >= 0) continue;
        const double own = (joints.positions[j] - joints.positions[at(joints.parents[j])]).norm();
        if (own > length) {
          length = own;
          best = static_cast<int>(j);
        }
      }
      return best;
    };
    int halved = longest(pairs_allowed);
    if (halved < 0) halved = longest(true);
    const int other = pairs_allowed ? mirrored[at(halved)] : -1;
    joints.halve(std::max(halved, other));
    if (other >= 0) joints.halve(std::min(halved, other));
  }
  return joints.skeleton();
}

Skeleton mirrored_skeleton(const Skeleton& skeleton, double middle, double size) {
  const Joints joints(skeleton);
  const Counterparts counterparts(joints, middle, size);
  Joints result = joints;
  std::vector<int> copy(joints.size(), -1);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const int joint = static_cast<int>(j), other = counterparts.of()[j];
    if (other >= 0) {
      const Eigen::Vector3d image = counterparts.image(other);
      result.positions[j] = 0.5 * (joints.positions[j] + image);
      if (other == joint) result.positions[j].x() = middle;
      continue;
    }
    const int parent = joints.parents[j], above = counterparts.of()[at(parent)];
    copy[j] = static_cast<int>(result.size());
    result.positions.push_back(counterparts.image(joint));
    result.parents.push_back(above >= 0 ? above : copy[at(parent)]);
    result.names.push_back(other_side(joints.names[j], result.names));
  }
  return result.skeleton();
}

Skeleton extended_skeleton(const Skeleton& skeleton, const Skeleton& other, const Mesh& mesh) {
  Joints joints(skeleton);
  joints.named_by_place = false;
  const Points given = joints.positions, places = other.positions();
  const double size = bounding_box(mesh.vertices).diagonal();
  const geometry::NearestSurface surface(mesh);
  const auto is_reached = [&](const Eigen::Vector3d& place) {
    double bone = INFINITY;
    for (std::size_t j = 0; j < given.size(); ++j) {
      const Eigen::Vector3d& from = given[at(std::max(0, skeleton.parents[j]))];
      bone = std::min(bone, geometry::distance_to_segment(place, from, given[j]));
    }
    return bone <= std::max(kUnreached * size, kUnreachedRadii * surface.query(place).distance);
  };
  // Branches of joints that are not reached: neighbours in the other tree, from the joint on that is nearest to ours.
  std::vector<std::vector<int>> neighbours(other.size());
  for (std::size_t j = 1; j < other.size(); ++j) {
    neighbours[j].push_back(other.parents[j]);
    neighbours[at(other.parents[j])].push_back(static_cast<int>(j));
  }
  std::vector<bool> is_done(other.size());
  for (std::size_t j = 0; j < other.size(); ++j) is_done[j] = is_reached(places[j]);
  std::size_t branches = 0;
  for (std::size_t first = 0; first < other.size(); ++first) {
    if (is_done[first]) continue;
    std::vector<int> part{static_cast<int>(first)};
    std::set<int> members{part.front()};
    double length = 0.0;
    for (std::size_t k = 0; k < part.size(); ++k) {
      is_done[at(part[k])] = true;
      for (const int next : neighbours[at(part[k])]) {
        if (is_done[at(next)] && members.count(next) == 0) {
          length += (places[at(next)] - places[at(part[k])]).norm();  // from where the branch leaves
        } else if (members.insert(next).second) {
          length += (places[at(next)] - places[at(part[k])]).norm();
          part.push_back(next);
        }
      }
    }
    if (length <= kLeastBranch * size) continue;
    int base = part.front(), anchor = 0;
    double nearest = INFINITY;
    for (const int joint : part) {
      for (std::size_t g = 0; g < given.size(); ++g) {
        const double apart = (given[g] - places[at(joint)]).norm();
        if (apart >= nearest) continue;
        nearest = apart;
        base = joint;
        anchor = static_cast<int>(g);
      }
    }
    ++branches;
    std::vector<std::pair<int, int>> open{{base, anchor}};
    members.erase(base);
    for (std::size_t k = 0; k < open.size(); ++k) {
      const auto [joint, parent] = open[k];
      const int added = static_cast<int>(joints.size());
      char name[48];
      std::snprintf(name, sizeof name, "added_%zu_%02zu", branches, k);
      std::string unique = name;
      while (std::find(joints.names.begin(), joints.names.end(), unique) != joints.names.end()) unique += "_2";
      joints.positions.push_back(places[at(joint)]);
      joints.parents.push_back(parent);
      joints.names.push_back(unique);
      for (const int next : neighbours[at(joint)]) {
        if (members.erase(next) > 0) open.push_back({next, added});
      }
    }
  }
  return joints.skeleton();
}

}  // namespace anigen::rigging
