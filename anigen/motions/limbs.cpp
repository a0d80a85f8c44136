#include "anigen/motions/limbs.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "anigen/asset/joint_side.h"
#include "anigen/core/numeric.h"

namespace anigen::motions {

namespace {

using Eigen::Vector3d;

constexpr double kLeastMass = 1e-4;     ///< share of the surface below which a subtree is no limb
constexpr double kGround = 0.07;        ///< heights above the ground that still count as touching it
constexpr double kLeastLegDrop = 0.18;  ///< heights that a leg goes down at least
constexpr double kLeastLimb = 0.08;     ///< sizes that arms, wings and tails are long at least

const std::vector<std::string> kLegWords = {"leg", "thigh", "shin", "foot", "feet", "calf", "knee", "paw", "hoof"};
const std::vector<std::string> kWingWords = {"wing", "flipper"};
const std::vector<std::string> kFinWords = {"fin_", "fin.", "_fin", ".fin", "finl", "finr", "pectoral", "pelvic"};
const std::vector<std::string> kArmWords = {"arm", "hand", "shoulder", "clavicle", "elbow", "claw", "wrist"};

/// Finds the parts; each step uses what the steps before have left.
class Analysis {
 public:
  explicit Analysis(Body& body) : body_(body), figure_(body.figure), used_(figure_.joints(), 0) {}

  void run() {
    find_root();
    find_lateral();
    find_legs();
    find_axis();
    find_trunk();
    find_head_and_tail();
    find_other_lateral();
    find_chains();
    order_limbs();
    for (std::size_t i = 0; i < body_.limbs.size(); ++i) {
      if (body_.limbs[i].kind == LimbKind::kLeg) find_leg_joints(body_.limbs[i]);
    }
  }

 private:
  const Vector3d& place(int joint) const { return figure_.tree.positions[at(joint)]; }
  int parent(int joint) const { return figure_.tree.parents[at(joint)]; }
  bool is_active(int joint) const { return figure_.mass_below[at(joint)] >= kLeastMass; }
  double along(int joint) const { return figure_.forward.dot(place(joint)); }
  double aside(int joint) const { return figure_.left.dot(place(joint)) - figure_.middle; }
  bool is_midline(int joint) const { return lateral_[at(joint)] == 0; }

  std::vector<int> active_children(int joint) const {
    std::vector<int> result;
    for (const int child : figure_.children[at(joint)]) {
      if (is_active(child)) result.push_back(child);
    }
    return result;
  }

  void find_root() {
    body_.root = figure_.order.front();
    for (;;) {
      const std::vector<int> below = active_children(body_.root);
      if (figure_.mass[at(body_.root)] > kLeastMass || below.size() != 1) return;
      body_.root = below.front();
    }
  }

  /// Joints beside the plane of symmetry, and all that hangs on them.
  void find_lateral() {
    lateral_.assign(figure_.joints(), 0);
    for (const int j : figure_.order) {
      const int above = parent(j), mirrored = figure_.mirror[at(j)];
      if (above >= 0 && lateral_[at(above)] != 0) {
        lateral_[at(j)] = lateral_[at(above)];
      } else if (above >= 0 && j != body_.root && figure_.is_below(j, body_.root)) {
        const bool paired = mirrored >= 0 && mirrored != j;
        const bool beside = mirrored < 0 && std::abs(aside(j)) > 0.05 * figure_.size;
        if (paired || beside) lateral_[at(j)] = aside(j) >= 0.0 ? 1 : -1;
        const int named = side_of_name(figure_.names[at(j)]).side;
        if (paired && named != 0 && std::abs(aside(j)) < 0.01 * figure_.size) lateral_[at(j)] = named;
      }
    }
  }

  double reach_below(int joint, const Vector3d& from) const {
    double reach = 0.0;
    for (const int j : figure_.subtree(joint)) {
      reach = std::max(reach, (place(j) - from).norm());
      for (const Vector3d& p : figure_.surface[at(j)]) reach = std::max(reach, (p - from).norm());
    }
    return reach;
  }

  /// The chain from a joint outwards. @param down towards the ground; else to where it leads farthest
  std::vector<int> main_chain(int first, bool down) const {
    std::vector<int> chain = {first};
    for (;;) {
      const std::vector<int> below = active_children(chain.back());
      if (below.empty()) return chain;
      int best = below.front();
      double most = -std::numeric_limits<double>::infinity();
      for (const int child : below) {
        const std::vector<int> part = figure_.subtree(child);
        double value = reach_below(child, place(chain.back()));
        if (down) {
          const double lowest = figure_.lowest(part);
          value = -std::max(0.0, lowest - figure_.box.low.z() - 0.02 * figure_.height) +
                  0.02 * figure_.height * figure_.mass_below[at(child)];
        }
        if (value > most) std::tie(best, most) = std::pair(child, value);
      }
      chain.push_back(best);
    }
  }

  Vector3d far_end(const std::vector<int>& chain) const {
    Vector3d best = place(chain.back());
    double most = (best - place(chain.front())).norm();
    for (const int j : figure_.subtree(chain.back())) {
      for (const Vector3d& p : figure_.surface[at(j)]) {
        const double distance = (p - place(chain.front())).norm();
        if (distance > most) std::tie(best, most) = std::pair(p, distance);
      }
    }
    return best;
  }

  Limb limb(LimbKind kind, std::vector<int> chain, int side) const {
    Limb result;
    result.kind = kind;
    result.side = side;
    result.attached = parent(chain.front());
    result.tip = far_end(chain);
    result.joints = std::move(chain);
    return result;
  }

  void add(Limb limb) {
    for (const int j : figure_.subtree(limb.joints.front())) used_[at(j)] = 1;
    body_.limbs.push_back(std::move(limb));
  }

  bool any_says(const std::vector<int>& joints, const std::vector<std::string>& words) const {
    return std::any_of(joints.begin(), joints.end(), [&](int j) { return name_says(figure_.names[at(j)], words); });
  }

  bool is_leg(int first) const {
    const std::vector<int> part = figure_.subtree(first);
    const double ground = figure_.box.low.z(), lowest = figure_.lowest(part);
    const std::vector<int> chain = main_chain(first, true);
    const bool named = any_says(chain, kLegWords) && !any_says({first}, kWingWords);
    const double drop = place(first).z() - lowest;
    if (lowest > ground + (named ? 0.25 : kGround) * figure_.height) return false;
    if (named) return drop > 0.05 * figure_.height;
    if (chain.size() < 2) return false;
    if (any_says(chain, kWingWords) || any_says(chain, kFinWords)) return false;
    if (drop < kLeastLegDrop * figure_.height) return false;
    // The belly of what lies or swims is as low as its fins.
    const int above = parent(first);
    std::vector<int> belly = {above};
    for (const int near : active_children(above)) {
      if (is_midline(near)) belly.push_back(near);
    }
    if (parent(above) >= 0) belly.push_back(parent(above));
    double lowest_belly = std::numeric_limits<double>::infinity();
    for (const int j : belly) {
      const Vector3d& here = place(first);
      for (const Vector3d& p : figure_.surface[at(j)]) {
        if (std::abs(figure_.forward.dot(p - here)) < 0.1 * figure_.size) lowest_belly = std::min(lowest_belly, p.z());
      }
    }
    return lowest_belly > ground + 0.06 * figure_.height;
  }

  std::vector<int> lateral_roots() const {
    std::vector<int> result;
    for (const int j : figure_.order) {
      if (is_active(j) && !is_midline(j) && parent(j) >= 0 && is_midline(parent(j))) result.push_back(j);
    }
    return result;
  }

  void find_legs() {
    std::vector<int> legs;
    for (const int first : lateral_roots()) {
      if (is_leg(first)) legs.push_back(first);
    }
    for (const int first : legs) {
      // A limb without a counterpart carries nothing, unless rigs are lopsided.
      const int other = figure_.mirror[at(first)];
      const bool paired = other >= 0 && std::find(legs.begin(), legs.end(), other) != legs.end();
      const int side = lateral_[at(first)];
      const auto opposite = std::count_if(legs.begin(), legs.end(), [&](int j) { return lateral_[at(j)] == -side; });
      const auto same = std::count_if(legs.begin(), legs.end(), [&](int j) { return lateral_[at(j)] == side; });
      if (paired || opposite == same) add(limb(LimbKind::kLeg, main_chain(first, true), side));
    }
    pair_up(LimbKind::kLeg);
  }

  /// Partners by mirrored joints, else by nearest mirrored ends.
  void pair_up(LimbKind kind) {
    std::vector<std::size_t> left, right;
    for (std::size_t i = 0; i < body_.limbs.size(); ++i) {
      Limb& limb = body_.limbs[i];
      if (limb.kind != kind || limb.side == 0) continue;
      limb.partner = -1;
      (limb.side > 0 ? left : right).push_back(i);
    }
    const auto mirrored = [&](const Vector3d& p) {
      return Vector3d(p + 2.0 * (figure_.middle - figure_.left.dot(p)) * figure_.left);
    };
    while (!left.empty() && !right.empty()) {
      std::pair<std::size_t, std::size_t> best(0, 0);
      double least = std::numeric_limits<double>::infinity();
      for (std::size_t a = 0; a < left.size(); ++a) {
        for (std::size_t b = 0; b < right.size(); ++b) {
          const Limb &one = body_.limbs[left[a]], &other = body_.limbs[right[b]];
          double distance = (mirrored(one.tip) - other.tip).norm() +
                            (mirrored(place(one.joints.front())) - place(other.joints.front())).norm();
          if (figure_.mirror[at(one.joints.front())] == other.joints.front()) distance -= figure_.size;
          if (distance < least) std::tie(best, least) = std::pair(std::pair(a, b), distance);
        }
      }
      body_.limbs[left[best.first]].partner = static_cast<int>(right[best.second]);
      body_.limbs[right[best.second]].partner = static_cast<int>(left[best.first]);
      left.erase(left.begin() + static_cast<std::ptrdiff_t>(best.first));
      right.erase(right.begin() + static_cast<std::ptrdiff_t>(best.second));
    }
  }

  /// Joint of the midline that a lateral limb of some length hangs on.
  void find_trunk() {
    int hind = -1, front = -1;
    double least = std::numeric_limits<double>::infinity();
    for (const Limb& leg : body_.limbs) {
      if (leg.tip.allFinite() && figure_.forward.dot(leg.tip) < least)
        std::tie(hind, least) = std::pair(leg.attached, figure_.forward.dot(leg.tip));
    }
    const bool legless = hind < 0;
    if (legless) hind = body_.root;
    double farthest = 0.0;
    for (const int first : lateral_roots()) {
      const bool long_enough = reach_below(first, place(first)) > 0.15 * figure_.size;
      if (!long_enough || any_says({parent(first)}, {"head", "neck"})) continue;
      double distance = 0.0;
      const std::vector<int> way = figure_.path(hind, parent(first));
      for (std::size_t i = 1; i < way.size(); ++i) distance += (place(way[i]) - place(way[i - 1])).norm();
      const bool ahead = legless || along(parent(first)) - along(hind) + place(parent(first)).z() - place(hind).z() > 0;
      if (ahead && distance > farthest) std::tie(front, farthest) = std::pair(parent(first), distance);
    }
    body_.trunk = front < 0 ? std::vector<int>{hind} : figure_.path(hind, front);
  }

  /// The chain from the trunk to a midline tip, without joints of the trunk.
  std::vector<int> from_trunk(int tip) const {
    std::vector<int> chain;
    for (int j = tip; j >= 0; j = parent(j)) {
      if (std::find(body_.trunk.begin(), body_.trunk.end(), j) != body_.trunk.end() || j == body_.root) break;
      chain.insert(chain.begin(), j);
    }
    return chain;
  }

  void find_head_and_tail() {
    std::vector<int> tips;
    for (const int j : figure_.order) {
      if (!is_active(j) || !is_midline(j) || used_[at(j)] != 0 || from_trunk(j).empty()) continue;
      const std::vector<int> below = active_children(j);
      if (std::none_of(below.begin(), below.end(), [&](int child) { return is_midline(child); })) tips.push_back(j);
    }
    const bool upright = is_upright_so_far();
    const int chest = body_.trunk.back(), pelvis = body_.trunk.front();
    const auto end_of = [&](int tip) { return far_end({from_trunk(tip).front(), tip}); };
    int head = -1, tail = -1;
    double best_head = 0.05, best_tail = kLeastLimb;
    const bool legless = body_.of_kind(LimbKind::kLeg).empty();
    // A plant has tips, too.
    const bool is_creature = !legless || !body_.axis.empty() || has_named_wings();
    for (const int tip : tips) {
      const std::vector<int> chain = from_trunk(tip);
      if (!is_creature && !any_says(chain, {"head"})) continue;
      const Vector3d way = (end_of(tip) - place(legless ? body_.root : chest)) / figure_.size;
      double score = figure_.forward.dot(way) + (upright ? 1.0 : legless ? 0.1 : 0.6) * way.z();
      if (any_says(chain, {"head"})) score += 2.0;
      if (any_says(chain, {"tail"})) score -= 2.0;
      if (score > best_head) std::tie(head, best_head) = std::pair(tip, score);
    }
    for (const int tip : tips) {
      if (tip == head) continue;
      const std::vector<int> chain = from_trunk(tip);
      const Vector3d way = (end_of(tip) - place(legless ? body_.root : pelvis)) / figure_.size;
      double score = -figure_.forward.dot(way);
      const bool named = any_says(chain, {"tail"});
      if (!is_creature && !named) continue;
      if (named) score += 1.0;
      if (any_says(chain, {"head", "jaw"})) score -= 2.0;
      if (upright && !named && place(chain.front()).z() > place(pelvis).z() + 0.1 * figure_.height) continue;
      if (score > best_tail) std::tie(tail, best_tail) = std::pair(tip, score);
    }
    if (head >= 0) add_head(head);
    if (tail >= 0) {
      std::vector<int> chain = from_trunk(tail);
      if (head >= 0) {  // what both share belongs to the body
        const std::vector<int> other = from_trunk(head);
        while (chain.size() > 1 && std::find(other.begin(), other.end(), chain.front()) != other.end())
          chain.erase(chain.begin());
      }
      add(limb(LimbKind::kTail, std::move(chain), 0));
    }
  }

  bool has_named_wings() const {
    const std::vector<int> roots = lateral_roots();
    return std::any_of(roots.begin(), roots.end(), [&](int j) { return any_says(main_chain(j, false), kWingWords); });
  }

  void add_head(int tip) {
    std::vector<int> chain = from_trunk(tip);
    std::size_t head = chain.size();
    for (std::size_t i = 0; i < chain.size() && head == chain.size(); ++i) {
      if (name_says(figure_.names[at(chain[i])], {"head"})) head = i;
    }
    if (head == chain.size()) {  // the heaviest joint, since jaws and noses hang on it
      head = 0;
      for (std::size_t i = 1; i < chain.size(); ++i) {
        if (figure_.mass[at(chain[i])] >= figure_.mass[at(chain[head])]) head = i;
      }
    }
    chain.resize(head + 1);
    Limb result = limb(LimbKind::kHead, chain, 0);
    // A body may turn its head only where neither legs nor arms hang on it.
    for (const int j : figure_.subtree(chain.front())) used_[at(j)] |= 2;
    body_.limbs.push_back(std::move(result));
  }

  bool is_upright_so_far() const {
    const auto legs = static_cast<std::size_t>(body_.of_kind(LimbKind::kLeg).size());
    if (legs != 2) return false;
    const Vector3d extent = figure_.box.high - figure_.box.low;
    const Vector3d way = place(body_.trunk.back()) - place(body_.trunk.front());
    if (way.norm() > 0.05 * figure_.size) return way.z() > std::abs(figure_.forward.dot(way));
    return extent.z() > 1.2 * std::abs(figure_.forward.dot(extent));
  }

  bool is_flat(const std::vector<int>& joints) const {
    Vector3d mean = Vector3d::Zero();
    std::size_t count = 0;
    for (const int j : joints) {
      for (const Vector3d& p : figure_.surface[at(j)]) mean += p, ++count;
    }
    if (count < 8) return false;
    mean /= static_cast<double>(count);
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const int j : joints) {
      for (const Vector3d& p : figure_.surface[at(j)]) spread += (p - mean) * (p - mean).transpose();
    }
    const Eigen::Vector3d values = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvalues();
    return values[0] < 0.1 * values[1] && values[1] > 0.04 * values[2];
  }

  std::string joined_names(const std::vector<int>& joints) const {
    std::string text;
    for (const int j : joints) text += figure_.names[at(j)] + " ";
    return text;
  }

  void find_other_lateral() {
    const std::size_t legs = body_.of_kind(LimbKind::kLeg).size();
    int head = -1;
    for (const Limb& one : body_.limbs) {
      if (one.kind == LimbKind::kHead) head = one.joints.back();
    }
    for (const int first : lateral_roots()) {
      if ((used_[at(first)] & 1) != 0 || (head >= 0 && figure_.is_below(first, head) && legs > 0)) continue;
      const std::vector<int> chain = main_chain(first, false), part = figure_.subtree(first);
      const double length = reach_below(first, place(first));
      const bool wing = any_says(chain, kWingWords), arm = any_says(chain, kArmWords), fin = any_says(chain, kFinWords);
      if (length < (wing || arm || fin ? 0.5 : 1.0) * kLeastLimb * figure_.size) continue;
      LimbKind kind = LimbKind::kArm;
      if (wing && name_says(joined_names(chain), {"wing"})) {
        kind = LimbKind::kWing;
      } else if (fin || wing || (legs == 0 && !body_.axis.empty())) {
        kind = LimbKind::kFin;
      } else if (!arm && is_flat(part) && length > 0.3 * figure_.size) {
        kind = LimbKind::kWing;
      } else if (!arm && legs == 0) {
        continue;  // a branch
      }
      add(limb(kind, chain, lateral_[at(first)]));
    }
    for (const LimbKind kind : {LimbKind::kArm, LimbKind::kWing, LimbKind::kFin}) pair_up(kind);
  }

  double body_length() const { return std::abs(figure_.forward.dot(figure_.box.high - figure_.box.low)); }

  /// The line of the body from head to tail, where it is long and has three joints or more.
  void find_axis() {
    if (!body_.of_kind(LimbKind::kLeg).empty()) return;
    int front = -1, back = -1;
    double most = -std::numeric_limits<double>::infinity(), least = -most;
    for (const int j : figure_.order) {
      if (!is_active(j) || !is_midline(j) || !figure_.is_below(j, body_.root)) continue;
      if (along(j) > most) std::tie(front, most) = std::pair(j, along(j));
      if (along(j) < least) std::tie(back, least) = std::pair(j, along(j));
    }
    if (front < 0 || front == back) return;
    std::vector<int> line = figure_.path(front, back);
    if (line.size() < 3 || most - least < 0.25 * body_length() || body_length() < 0.6 * figure_.size) return;
    const double rise = std::abs(place(front).z() - place(back).z());
    if (rise > most - least) return;
    body_.axis = std::move(line);
  }

  /// Chains of three joints or more that no limb has taken.
  void find_chains() {
    std::set<int> taken(body_.trunk.begin(), body_.trunk.end());
    taken.insert(body_.axis.begin(), body_.axis.end());
    for (const Limb& one : body_.limbs) taken.insert(one.joints.begin(), one.joints.end());
    const bool whole = body_.limbs.empty() && body_.axis.empty();
    if (whole) taken = {body_.root};
    for (const int j : figure_.order) {
      if (!is_active(j) || taken.count(j) > 0 || (used_[at(j)] & 1) != 0 || !figure_.is_below(j, body_.root)) continue;
      std::vector<int> chain = main_chain(j, false);
      for (const int part : chain) taken.insert(part);
      if (chain.size() < (whole ? 2U : 3U) || reach_below(j, place(j)) < kLeastLimb * figure_.size) continue;
      body_.limbs.push_back(limb(LimbKind::kChain, std::move(chain), lateral_[at(j)]));
    }
  }

  void order_limbs() {
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < body_.limbs.size(); ++i) order.push_back(i);
    const auto pair_place = [&](const Limb& limb) {
      double place = figure_.forward.dot(limb.tip);
      if (limb.partner >= 0) place = 0.5 * (place + figure_.forward.dot(body_.limbs[at(limb.partner)].tip));
      return place;
    };
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      const Limb &one = body_.limbs[a], &other = body_.limbs[b];
      if (one.kind != other.kind) return one.kind < other.kind;
      const double here = pair_place(one), there = pair_place(other);
      if (std::abs(here - there) > 1e-9 * figure_.size) return here > there;
      return one.side > other.side;
    });
    std::vector<int> now(order.size());
    for (std::size_t i = 0; i < order.size(); ++i) now[order[i]] = static_cast<int>(i);
    std::vector<Limb> sorted;
    for (const std::size_t i : order) {
      sorted.push_back(body_.limbs[i]);
      if (sorted.back().partner >= 0) sorted.back().partner = now[at(sorted.back().partner)];
    }
    body_.limbs = std::move(sorted);
  }

  void find_leg_joints(Limb& leg) const {
    const double ground = figure_.lowest(figure_.subtree(leg.joints.front()));
    const double touch = ground + 0.05 * figure_.height;
    const std::vector<int>& joints = leg.joints;
    leg.ankle = joints.size() - 1;
    for (std::size_t i = joints.size(); i-- > 0;) {
      const bool touches = figure_.lowest({joints[i]}) < touch;
      const bool is_low = place(joints[i]).z() < ground + 0.3 * (place(joints.front()).z() - ground);
      if (touches && is_low) leg.ankle = i;
      if (!is_low) break;
    }
    leg.hip = 0;
    // Shoulder blades and pelvic bones lead to the hip, and are short and level.
    while (leg.hip + 2 < leg.ankle) {
      const Vector3d bone = place(joints[leg.hip + 1]) - place(joints[leg.hip]);
      const Vector3d rest = place(joints[leg.ankle]) - place(joints[leg.hip + 1]);
      if (bone.norm() > 0.3 * rest.norm() || -bone.z() > 0.6 * bone.norm()) break;
      ++leg.hip;
    }
    leg.knee = leg.hip;
    const Vector3d hip = place(joints[leg.hip]), way = place(joints[leg.ankle]) - hip;
    double farthest = -1.0;
    for (std::size_t i = leg.hip + 1; i < leg.ankle; ++i) {
      const Vector3d here = place(joints[i]) - hip;
      const double share = way.squaredNorm() > 0.0 ? here.dot(way) / way.squaredNorm() : 0.0;
      const double off = (here - share * way).norm() / std::max(way.norm(), 1e-12);
      // A straight leg bends near its middle.
      const double value = off + 0.1 * (0.5 - std::abs(share - 0.5));
      if (value > farthest) std::tie(leg.knee, farthest) = std::pair(i, value);
    }
    Vector3d sum = Vector3d::Zero();
    std::size_t count = 0;
    for (const int j : figure_.subtree(joints[leg.ankle])) {
      for (const Vector3d& p : figure_.surface[at(j)]) {
        if (p.z() < ground + 0.03 * figure_.height) sum += p, ++count;
      }
    }
    leg.contact = count > 0 ? Vector3d(sum / static_cast<double>(count)) : place(joints[leg.ankle]);
    leg.contact.z() = ground;
  }

  Body& body_;
  const Figure& figure_;
  std::vector<int> used_;  // 1: part of a limb, 2: of head and neck
  std::vector<int> lateral_;
};

}  // namespace

const char* name_of(LimbKind kind) {
  switch (kind) {
    case LimbKind::kLeg:
      return "leg";
    case LimbKind::kArm:
      return "arm";
    case LimbKind::kWing:
      return "wing";
    case LimbKind::kFin:
      return "fin";
    case LimbKind::kHead:
      return "head";
    case LimbKind::kTail:
      return "tail";
    case LimbKind::kChain:
      break;
  }
  return "chain";
}

std::vector<int> Body::of_kind(LimbKind kind) const {
  std::vector<int> result;
  for (std::size_t i = 0; i < limbs.size(); ++i) {
    if (limbs[i].kind == kind) result.push_back(static_cast<int>(i));
  }
  return result;
}

std::vector<std::array<int, 2>> Body::leg_pairs() const {
  std::vector<std::array<int, 2>> result;
  for (const int i : of_kind(LimbKind::kLeg)) {
    if (limbs[at(i)].side > 0 && limbs[at(i)].partner >= 0) result.push_back({i, limbs[at(i)].partner});
  }
  return result;
}

bool Body::is_upright() const {
  if (of_kind(LimbKind::kLeg).size() != 2) return false;
  const auto& places = figure.tree.positions;
  Eigen::Vector3d way = places[at(trunk.back())] - places[at(trunk.front())];
  const std::vector<int> heads = of_kind(LimbKind::kHead);
  if (way.norm() < 0.05 * figure.size && !heads.empty())
    way = places[at(limbs[at(heads.front())].joints.back())] - places[at(trunk.front())];
  return way.z() > std::abs(figure.forward.dot(way));
}

bool Body::is_snake() const {
  if (axis.size() < 5) return false;
  const double length = std::abs(figure.forward.dot(figure.box.high - figure.box.low));
  const double width = std::abs(figure.left.dot(figure.box.high - figure.box.low));
  return length > 4.0 * std::max(figure.height, width);
}

double Body::leg_length() const {
  double least = 0.0;
  for (const int i : of_kind(LimbKind::kLeg)) {
    const Limb& leg = limbs[at(i)];
    const double length = figure.tree.positions[at(leg.joints[leg.hip])].z() - leg.contact.z();
    least = least > 0.0 ? std::min(least, length) : length;
  }
  return least;
}

Body analyse(Figure figure) {
  Body body;
  body.figure = std::move(figure);
  Analysis(body).run();
  return body;
}

std::string describe(const Body& body) {
  std::string text;
  for (const LimbKind kind : {LimbKind::kLeg, LimbKind::kArm, LimbKind::kWing, LimbKind::kFin, LimbKind::kHead,
                              LimbKind::kTail, LimbKind::kChain}) {
    const std::size_t count = body.of_kind(kind).size();
    if (count == 0) continue;
    text += text.empty() ? "" : ", ";
    if (count > 1) text += std::to_string(count) + " ";
    text += std::string(name_of(kind)) + (count > 1 ? "s" : "");
  }
  if (!body.axis.empty()) text += (text.empty() ? "" : ", ") + std::string(body.is_snake() ? "long body" : "long axis");
  return text.empty() ? "no limbs" : text;
}

}  // namespace anigen::motions
