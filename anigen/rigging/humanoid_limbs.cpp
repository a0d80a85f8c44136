#include "anigen/rigging/humanoid_limbs.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::rigging {

namespace {

using Joints = std::array<int, kHumanBones>;
using Points = std::vector<Eigen::Vector3d>;

// Parts of the height between the lowest and the highest joint.
constexpr double kApartAcross = 0.06;  // the limbs of a pair, in the mean
constexpr double kBeside = 0.02;       // joints of a pair that say in which direction they are apart
constexpr double kUnevenLevel = 0.35;  // tips of a pair: bodies stand in poses, too
constexpr double kLeastLeg = 0.05;     // drop from hip to foot
constexpr double kLeastArm = 0.12;     // way from shoulder to hand
constexpr double kGround = 0.12;       // feet end below it, hands above
constexpr double kLongerSide = 1.5;    // ways to the tips of a pair
// Distance along the body over that across it, up to which two joints lie beside each other.
constexpr double kAskew = 0.7;
// Part of the upper arm up to which a joint is its beginning and the one before a shoulder; twist joints come later.
constexpr double kShoulderShare = 0.35;
// Drop over way along the ground up to which the end of a leg is a foot.
constexpr double kFootSlope = 1.2;

/// Two limbs that mirror each other: from their first joint to the tip.
struct LimbPair {
  int above = -1;                          // the joint they begin at; -1: a root that carries nothing
  std::array<std::vector<int>, 2> chains;  // of +across, of −across
  double start = 0.0, tip = 0.0, lowest = 0.0, way = 0.0;
  std::size_t depth = 0;
};

class PlacedTree {
 public:
  PlacedTree(const Points& positions, const std::vector<int>& parents, const std::vector<char>& carries,
             const Eigen::Vector3d& across)
      : positions_(positions), across_(across), has_weights_(!carries.empty()), children_(positions.size()) {
    above_.assign(positions.size(), -1);
    reach_.assign(positions.size(), 0.0);
    const auto counts = [&](std::size_t j) { return carries.empty() || carries[j] != 0; };
    double high = -std::numeric_limits<double>::infinity();
    low_ = -high;
    for (std::size_t j = 0; j < positions.size(); ++j) {
      int parent = parents[j];
      while (parent >= 0 && !counts(at(parent))) parent = parents[at(parent)];
      above_[j] = parent;
      if (!counts(j)) continue;
      used_.push_back(static_cast<int>(j));
      (parent < 0 ? tops_ : children_[at(parent)]).push_back(static_cast<int>(j));
      low_ = std::min(low_, positions[j].z());
      high = std::max(high, positions[j].z());
    }
    height_ = high - low_;
    for (auto joint = used_.rbegin(); joint != used_.rend(); ++joint) {
      const int parent = above_[at(*joint)];
      if (parent >= 0) reach_[at(parent)] = std::max(reach_[at(parent)], reach_[at(*joint)] + length(parent, *joint));
    }
  }

  Joints bones() const {
    Joints joints;
    joints.fill(-1);
    if (used_.empty() || !(height_ > 0.0)) return joints;
    const std::vector<LimbPair> pairs = limb_pairs();
    const LimbPair* legs = chosen_legs(pairs);
    if (legs == nullptr) return joints;
    const LimbPair* arms = chosen_arms(pairs, *legs);
    for (const int side : {0, 1}) set_leg(legs->chains[at(side)], side, joints);
    if (arms == nullptr) return joints;
    for (const int side : {0, 1}) set_arm(arms->chains[at(side)], side, joints);
    set_hips(*legs, *arms, joints);
    set_head(*arms, joints);
    return joints;
  }

 private:
  const Eigen::Vector3d& place(int joint) const { return positions_[at(joint)]; }
  double length(int a, int b) const { return (place(a) - place(b)).norm(); }
  double aside(int joint) const { return place(joint).dot(across_); }

  /// From a joint along the child that leads farthest.
  std::vector<int> chain_from(int joint) const {
    std::vector<int> chain;
    while (joint >= 0) {
      chain.push_back(joint);
      int next = -1;
      double farthest = -1.0;
      for (const int child : children_[at(joint)]) {
        const double way = reach_[at(child)] + length(joint, child);
        if (way > farthest) {
          farthest = way;
          next = child;
        }
      }
      joint = next;
    }
    return chain;
  }

  double mean_aside(const std::vector<int>& chain) const {
    double sum = 0.0;
    for (const int joint : chain) sum += aside(joint);
    return sum / static_cast<double>(chain.size());
  }

  /// True where the first joints that are apart lie beside each other, as those of a leg and a tail do not.
  bool lie_across(const std::vector<int>& left, const std::vector<int>& right) const {
    for (std::size_t i = 0; i < std::min(left.size(), right.size()); ++i) {
      Eigen::Vector3d apart = place(left[i]) - place(right[i]);
      const double beside = apart.dot(across_);
      if (std::abs(beside) < kBeside * height_) continue;
      apart.z() = 0.0;
      return (apart - across_ * beside).norm() <= kAskew * std::abs(beside);
    }
    return true;
  }

  std::optional<LimbPair> pair_of(int above, int a, int b) const {
    LimbPair pair;
    pair.above = above;
    pair.chains = {chain_from(a), chain_from(b)};
    if (mean_aside(pair.chains[0]) < mean_aside(pair.chains[1])) std::swap(pair.chains[0], pair.chains[1]);
    const auto& [left, right] = pair.chains;
    if (mean_aside(left) - mean_aside(right) < kApartAcross * height_) return std::nullopt;
    if (above >= 0 && (mean_aside(left) - aside(above)) * (mean_aside(right) - aside(above)) > 0.0) return std::nullopt;
    const double first = reach_[at(left.front())], second = reach_[at(right.front())];
    if (std::max(first, second) > kLongerSide * std::min(first, second) + 1e-9 * height_) return std::nullopt;
    if (std::abs(place(left.back()).z() - place(right.back()).z()) > kUnevenLevel * height_) return std::nullopt;
    if (!lie_across(left, right)) return std::nullopt;
    if (std::max(left.size(), right.size()) > std::min(left.size(), right.size()) + 1) return std::nullopt;
    pair.start = 0.5 * (place(left.front()).z() + place(right.front()).z());
    pair.tip = 0.5 * (place(left.back()).z() + place(right.back()).z());
    pair.lowest = pair.tip;
    for (const std::vector<int>& chain : pair.chains) {
      for (const int joint : chain) pair.lowest = std::min(pair.lowest, place(joint).z());
    }
    pair.way = 0.5 * (first + second);
    for (int j = above; j >= 0; j = above_[at(j)]) ++pair.depth;
    return pair;
  }

  std::vector<LimbPair> limb_pairs() const {
    std::vector<LimbPair> pairs;
    const auto add = [&](int above, const std::vector<int>& children) {
      for (std::size_t i = 0; i < children.size(); ++i) {
        for (std::size_t k = i + 1; k < children.size(); ++k) {
          if (auto pair = pair_of(above, children[i], children[k])) pairs.push_back(std::move(*pair));
        }
      }
    };
    add(-1, tops_);
    for (const int joint : used_) add(joint, children_[at(joint)]);
    return pairs;
  }

  const LimbPair* chosen_legs(const std::vector<LimbPair>& pairs) const {
    const LimbPair* best = nullptr;
    for (const LimbPair& pair : pairs) {
      if (pair.start - pair.lowest < kLeastLeg * height_) continue;
      if (std::min(pair.chains[0].size(), pair.chains[1].size()) < 2) continue;
      // The longer of two that reach the ground: a toe is a limb, too.
      if (best == nullptr || pair.lowest < best->lowest - kGround * height_ ||
          (pair.lowest < best->lowest + kGround * height_ && pair.way > best->way)) {
        best = &pair;
      }
    }
    return best;
  }

  bool is_below(int joint, int above) const {
    for (int j = joint; j >= 0; j = above_[at(j)]) {
      if (j == above) return true;
    }
    return false;
  }

  const LimbPair* chosen_arms(const std::vector<LimbPair>& pairs, const LimbPair& legs) const {
    const LimbPair* best = nullptr;
    for (const LimbPair& pair : pairs) {
      if (&pair == &legs || pair.above == -1 || std::min(pair.chains[0].size(), pair.chains[1].size()) < 3) continue;
      if (is_below(pair.above, legs.chains[0].front()) || is_below(pair.above, legs.chains[1].front())) continue;
      if (pair.chains[0].front() == legs.chains[0].front() || pair.chains[0].front() == legs.chains[1].front())
        continue;
      if (pair.start < legs.start || pair.way < kLeastArm * height_ || pair.lowest < low_ + kGround * height_) continue;
      if (best == nullptr || pair.depth < best->depth || (pair.depth == best->depth && pair.way > best->way))
        best = &pair;
    }
    return best;
  }

  /// Places in a chain where two long bones of similar length begin, meet and end: those of the largest
  /// min(a, b)² / max(a, b). A joint in the middle of a bone makes both shorter or one much longer.
  /// @param first_end, last_end places that may be the end
  /// @param skip_shoulder the first joint begins no bone where the second lies near it
  std::optional<std::array<std::size_t, 3>> two_bones(const std::vector<int>& chain, std::size_t first_end,
                                                      std::size_t last_end, bool skip_shoulder) const {
    std::optional<std::array<std::size_t, 3>> best;
    double best_score = -1.0;
    for (std::size_t end = std::max<std::size_t>(2, first_end); end <= last_end && end < chain.size(); ++end) {
      for (std::size_t middle = 1; middle < end; ++middle) {
        for (std::size_t begin = 0; begin < middle; ++begin) {
          const bool is_shoulder = skip_shoulder && begin == 0 && middle > 1 &&
                                   length(chain[0], chain[1]) < kShoulderShare * length(chain[0], chain[middle]);
          if (is_shoulder) continue;
          const double upper = length(chain[begin], chain[middle]), lower = length(chain[middle], chain[end]);
          const double least = std::min(upper, lower), most = std::max(upper, lower);
          const double score = most > 0.0 ? least * least / most : 0.0;
          if (score <= best_score) continue;
          best_score = score;
          best = {begin, middle, end};
        }
      }
    }
    return best;
  }

  void set_leg(const std::vector<int>& chain, int side, Joints& joints) const {
    const auto set = [&](HumanBone bone, int joint) { joints[on_side(bone, side)] = joint; };
    if (chain.size() == 2) {  // the foot may hang elsewhere
      set(HumanBone::kLeftUpperLeg, chain[0]);
      set(HumanBone::kLeftLowerLeg, chain[1]);
      return;
    }
    const auto places = two_bones(chain, 2, chain.size() - 1, false);
    if (!places) return;
    auto [upper, lower, foot] = *places;
    for (; foot > lower + 1; --foot) {
      const Eigen::Vector3d step = place(chain[foot]) - place(chain[foot - 1]);
      if (std::abs(step.z()) > kFootSlope * std::hypot(step.x(), step.y())) break;
    }
    set(HumanBone::kLeftUpperLeg, chain[upper]);
    set(HumanBone::kLeftLowerLeg, chain[lower]);
    set(HumanBone::kLeftFoot, chain[foot]);
    if (foot + 1 < chain.size()) set(HumanBone::kLeftToes, chain[foot + 1]);
  }

  void set_arm(const std::vector<int>& chain, int side, Joints& joints) const {
    const auto set = [&](HumanBone bone, int joint) { joints[on_side(bone, side)] = joint; };
    // Fingers begin at the hand, and twist joints have no joints below.
    std::size_t first = 2, last = chain.size() - 1;
    for (std::size_t i = 2; i < chain.size(); ++i) {
      std::size_t fingers = 0;
      for (const int child : children_[at(chain[i])]) fingers += !children_[at(child)].empty();
      if (fingers < 2 && children_[at(chain[i])].size() < 3) continue;
      first = last = i;
      break;
    }
    const auto places = two_bones(chain, first, last, true);
    if (!places) return;
    const auto [upper, lower, hand] = *places;
    if (upper > 0) set(HumanBone::kLeftShoulder, chain[upper - 1]);
    set(HumanBone::kLeftUpperArm, chain[upper]);
    set(HumanBone::kLeftLowerArm, chain[lower]);
    set(HumanBone::kLeftHand, chain[hand]);
    set_fingers(chain[hand], chain[lower], side, joints);
  }

  /// Three to five fingers. The thumb begins nearest to the wrist or points aside; the others follow from it across
  /// the palm.
  void set_fingers(int hand, int elbow, int side, Joints& joints) const {
    std::vector<std::vector<int>> fingers;
    for (const int child : children_[at(hand)]) {
      std::vector<int> finger = chain_from(child);
      if (finger.size() >= 2) fingers.push_back(std::move(finger));
    }
    if (fingers.size() < 3 || fingers.size() > 5) return;
    const Eigen::Vector3d along = (place(hand) - place(elbow)).normalized();
    const auto advance = [&](const std::vector<int>& finger) {
      return (place(finger.back()) - place(hand)).dot(along);
    };
    std::sort(fingers.begin(), fingers.end(), [&](const auto& a, const auto& b) { return advance(a) < advance(b); });
    const Eigen::Vector3d thumb = place(fingers.front().back());
    std::sort(fingers.begin() + 1, fingers.end(), [&](const auto& a, const auto& b) {
      return (place(a.front()) - thumb).norm() < (place(b.front()) - thumb).norm();
    });
    for (std::size_t f = 0; f < fingers.size(); ++f) {
      const std::vector<int>& finger = fingers[f];
      const std::size_t skipped = finger.size() > 3 && has_weights_ && f > 0 ? finger.size() - 3 : 0;  // metacarpals
      for (std::size_t k = skipped; k < finger.size() && k < skipped + 3; ++k)
        joints[on_side(HumanBone::kLeftFirstFinger, side) + 3 * f + k - skipped] = finger[k];
    }
  }

  /// Between the legs, or, where these hang on a root, the first joint on the way to the arms that is as high as they.
  void set_hips(const LimbPair& legs, const LimbPair& arms, Joints& joints) const {
    int& hips = joints[index_of(HumanBone::kHips)];
    std::vector<int> way;
    for (int j = arms.above; j >= 0 && j != legs.above; j = above_[at(j)]) way.push_back(j);
    const double level = legs.start - 0.1 * height_;
    if (legs.above >= 0 && place(legs.above).z() >= level) {
      hips = legs.above;
      return;
    }
    for (auto joint = way.rbegin(); joint != way.rend() && hips < 0; ++joint) {
      if (place(*joint).z() >= level && *joint != arms.above) hips = *joint;
    }
  }

  void set_head(const LimbPair& arms, Joints& joints) const {
    int first = -1;
    double top = place(arms.above).z();
    for (const int child : children_[at(arms.above)]) {
      if (child == arms.chains[0].front() || child == arms.chains[1].front()) continue;
      double highest = place(child).z();
      for (const int joint : chain_from(child)) highest = std::max(highest, place(joint).z());
      const bool central = std::abs(aside(child) - aside(arms.above)) < kApartAcross * height_;
      if (!central || highest <= top) continue;
      top = highest;
      first = child;
    }
    if (first < 0) return;
    std::vector<int> way{first};
    while (children_[at(way.back())].size() == 1) way.push_back(children_[at(way.back())].front());
    const bool ends = children_[at(way.back())].empty();
    // Without weights the last of three is the end of the head.
    const std::size_t head = ends && !has_weights_ && way.size() > 2 ? way.size() - 2 : way.size() - 1;
    joints[index_of(HumanBone::kHead)] = way[head];
    if (head > 0) joints[index_of(HumanBone::kNeck)] = way[0];
  }

  const Points& positions_;
  const Eigen::Vector3d across_;
  const bool has_weights_;
  std::vector<std::vector<int>> children_;
  std::vector<int> above_, used_, tops_;
  std::vector<double> reach_;  // from a joint to the farthest tip below it
  double low_ = 0.0, height_ = 0.0;
};

}  // namespace

std::array<int, kHumanBones> joints_by_place(const Points& positions, const std::vector<int>& parents,
                                             const std::vector<char>& carries, const Eigen::Vector3d& across) {
  return PlacedTree(positions, parents, carries, across).bones();
}

}  // namespace anigen::rigging
