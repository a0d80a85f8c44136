#include "anigen/geometry/joint_names.h"

#include <algorithm>
#include <cstdio>
#include <tuple>

#include "anigen/core/error.h"

namespace anigen::geometry {
namespace {

// Mirrored joints may be this far from each other's image, as a share of the skeleton's diagonal.
constexpr double kMirrorTolerance = 0.05;

struct Chain {
  std::vector<std::size_t> joints;
  int parent = -1;  // the chain it begins at, and the place there
  std::size_t place = 0;
  double length = 0.0;  // from where it begins
  int twin = -1;        // the chain that mirrors it
};

class Chains {
 public:
  Chains(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents)
      : positions_(positions), parents_(parents), reach_(positions.size(), 0.0), children_(positions.size()) {
    Eigen::Vector3d low = positions[0], high = positions[0];
    for (std::size_t j = 0; j < positions.size(); ++j) {
      low = low.cwiseMin(positions[j]);
      high = high.cwiseMax(positions[j]);
      if (j > 0) children_[static_cast<std::size_t>(parents[j])].push_back(j);
    }
    tolerance_ = kMirrorTolerance * (high - low).norm();
    for (std::size_t j = positions.size(); j-- > 1;) {
      const auto parent = static_cast<std::size_t>(parents[j]);
      reach_[parent] = std::max(reach_[parent], reach_from_parent(j));
    }
    cut();
    pair();
  }

  bool has_extent() const { return tolerance_ > 0.0; }

  std::vector<std::string> names() const {
    std::vector<std::string> names(positions_.size());
    std::vector<int> number(chains_.size(), -1);
    int next = 0;
    for (std::size_t c = 0; c < chains_.size(); ++c) {
      if (number[c] >= 0) continue;
      number[c] = next++;
      if (chains_[c].twin >= 0) number[static_cast<std::size_t>(chains_[c].twin)] = number[c];
    }
    for (std::size_t c = 0; c < chains_.size(); ++c) {
      const char* side = chains_[c].twin < 0 ? "" : is_left(c) ? ".L" : ".R";
      for (std::size_t i = 0; i < chains_[c].joints.size(); ++i) {
        char text[64];
        std::snprintf(text, sizeof text, "chain_%d%s_%02zu", number[c], side, i);
        names[chains_[c].joints[i]] = text;
      }
    }
    return names;
  }

 private:
  double reach_from_parent(std::size_t j) const {
    return reach_[j] + (positions_[j] - positions_[static_cast<std::size_t>(parents_[j])]).norm();
  }

  /// Chains in the order of their numbers.
  void cut() {
    chains_.emplace_back();
    chains_[0].length = reach_[0];
    extend(0, 0);
    for (std::size_t c = 0; c < chains_.size(); ++c) {
      std::vector<std::tuple<double, std::size_t, std::size_t>> begins;  // −length, first joint, place
      const std::vector<std::size_t> joints = chains_[c].joints;
      for (std::size_t place = 0; place < joints.size(); ++place) {
        for (const std::size_t child : children_[joints[place]]) {
          if (place + 1 < joints.size() && child == joints[place + 1]) continue;
          begins.emplace_back(-reach_from_parent(child), child, place);
        }
      }
      std::sort(begins.begin(), begins.end());
      for (const auto& [length, first, place] : begins) {
        chains_.emplace_back();
        chains_.back().parent = static_cast<int>(c);
        chains_.back().place = place;
        chains_.back().length = -length;
        extend(chains_.size() - 1, first);
      }
    }
  }

  void extend(std::size_t chain, std::size_t joint) {
    while (true) {
      chains_[chain].joints.push_back(joint);
      int next = -1;
      for (const std::size_t child : children_[joint]) {
        if (is_side(child)) continue;
        if (next < 0 || reach_from_parent(child) > reach_from_parent(static_cast<std::size_t>(next))) {
          next = static_cast<int>(child);
        }
      }
      if (next < 0) return;
      joint = static_cast<std::size_t>(next);
    }
  }

  Eigen::Vector3d mirrored(std::size_t joint) const {
    Eigen::Vector3d image = positions_[joint];
    image.x() = 2.0 * positions_[0].x() - image.x();
    return image;
  }

  /// One of two siblings that mirror each other: neither goes on for both.
  bool is_side(std::size_t joint) const {
    for (const std::size_t other : children_[static_cast<std::size_t>(parents_[joint])]) {
      if (other == joint ||
          (positions_[joint].x() > positions_[0].x()) == (positions_[other].x() > positions_[0].x())) {
        continue;
      }
      if ((positions_[other] - mirrored(joint)).norm() < tolerance_) return true;
    }
    return false;
  }

  /// The largest distance of a joint of one chain from the image of the other's.
  double mirror_distance(const Chain& a, const Chain& b) const {
    double largest = 0.0;
    for (std::size_t i = 0; i < a.joints.size(); ++i) {
      largest = std::max(largest, (positions_[a.joints[i]] - mirrored(b.joints[i])).norm());
    }
    return largest;
  }

  double mean_offset(const Chain& chain) const {
    double sum = 0.0;
    for (const std::size_t joint : chain.joints) sum += positions_[joint].x() - positions_[0].x();
    return sum / static_cast<double>(chain.joints.size());
  }
  bool is_left(std::size_t c) const { return mean_offset(chains_[c]) > 0.0; }

  bool begin_alike(const Chain& a, const Chain& b) const {
    if (a.place != b.place || a.parent < 0 || b.parent < 0) return false;
    return a.parent == b.parent || chains_[static_cast<std::size_t>(a.parent)].twin == b.parent;
  }

  void pair() {
    for (std::size_t a = 1; a < chains_.size(); ++a) {
      if (chains_[a].twin >= 0) continue;
      double least = tolerance_;
      int twin = -1;
      for (std::size_t b = a + 1; b < chains_.size(); ++b) {
        if (chains_[b].twin >= 0 || chains_[a].joints.size() != chains_[b].joints.size()) continue;
        if (!begin_alike(chains_[a], chains_[b])) continue;
        if (mean_offset(chains_[a]) * mean_offset(chains_[b]) >= 0.0) continue;
        const double distance = mirror_distance(chains_[a], chains_[b]);
        if (distance < least) {
          least = distance;
          twin = static_cast<int>(b);
        }
      }
      if (twin < 0) continue;
      chains_[a].twin = twin;
      chains_[static_cast<std::size_t>(twin)].twin = static_cast<int>(a);
    }
  }

  const std::vector<Eigen::Vector3d>& positions_;
  const std::vector<int>& parents_;
  std::vector<double> reach_;  // from a joint to the farthest tip below it
  std::vector<std::vector<std::size_t>> children_;
  double tolerance_ = 0.0;
  std::vector<Chain> chains_;
};

}  // namespace

std::vector<std::string> joint_names(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents) {
  if (positions.size() != parents.size()) throw InputError("", "", "joint_names: as many parents as positions");
  if (positions.empty()) return {};
  for (std::size_t j = 0; j < parents.size(); ++j) {
    const bool ordered = j == 0 ? parents[j] == -1 : parents[j] >= 0 && static_cast<std::size_t>(parents[j]) < j;
    if (!ordered) throw InputError("", "joint " + std::to_string(j), "parents come before children, the root first");
    if (!positions[j].allFinite()) throw InputError("", "joint " + std::to_string(j), "is not finite");
  }
  const Chains chains(positions, parents);
  if (chains.has_extent()) return chains.names();
  std::vector<std::string> names;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    char text[32];
    std::snprintf(text, sizeof text, "joint_%03zu", j);
    names.emplace_back(text);
  }
  return names;
}

}  // namespace anigen::geometry
