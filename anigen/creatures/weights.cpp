#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/creatures/body.h"
#include "anigen/creatures/surface.h"

namespace anigen::creatures {

namespace {

using Eigen::Vector3d;
using Row = std::vector<std::pair<int, double>>;
constexpr int kHops = 3;

void add(Row& row, int joint, double weight) {
  if (weight <= 0.0) return;
  for (auto& [j, w] : row) {
    if (j == joint) {
      w += weight;
      return;
    }
  }
  row.emplace_back(joint, weight);
}

class Painter {
 public:
  Painter(const Body& body, const Surface& surface) : body_(body), surface_(surface), joints_(body.joints.size()) {
    Rng rng = body.rng;
    // Bands end before the next joint, except in the few assets whose author smeared weights over several bones.
    const double longest = !body.machine && rng.chance(0.15) ? 2.5 : 0.9;
    const double widen = longest > 1.0 ? 1.6 : 1.0;
    for (int j = 0; j < static_cast<int>(joints_.size()); ++j) {
      const BodyJoint& joint = body.joints[j];
      Info& info = joints_[j];
      info.parent = joint.parent;
      info.active = joint.carries_skin && joint.twist_of < 0;
      if (joint.twist_of >= 0) joints_[joint.twist_of].twists.push_back(j);
      if (!info.active) continue;
      while (info.parent >= 0 && !joints_[info.parent].active) info.parent = joints_[info.parent].parent;
      info.depth = info.parent < 0 ? 0 : joints_[info.parent].depth + 1;
      Vector3d normal = (joint.tail - joint.position).normalized();
      double shortest = (joint.tail - joint.position).norm();
      if (info.parent >= 0) {
        joints_[info.parent].children.push_back(j);
        const Vector3d in = joint.position - body.joints[info.parent].position;
        if (in.norm() > 1e-9) {
          normal += in.normalized();
          shortest = std::min(shortest, in.norm());
        }
      }
      info.normal = normal.norm() > 1e-3 ? normal.normalized() : Vector3d::UnitZ();
      info.band = widen * body.softness * joint.radius * rng.uniform(0.75, 1.3);
      info.band = std::max(std::min(info.band, longest * shortest), 1e-6);
    }
    neighbours();
  }

  SkinWeights run() {
    const std::size_t count = surface_.vertices.size();
    owners_.resize(count);
    shared_.resize(count, false);
    std::vector<Row> rows(count);
    for (std::size_t v = 0; v < count; ++v) rows[v] = initial(v);
    for (int n = 0; n < body_.weight_smoothing; ++n) rows = diffuse(rows);
    const double least = body_.softness < 0.3 ? 0.06 : 0.025;
    SkinWeights weights;
    for (std::size_t v = 0; v < count; ++v) {
      if (!shared_[v]) keep_to_one_limb(rows[v]);
      weights.append_row(finish(v, rows[v], least));
    }
    return limit_influences(weights, 8);
  }

 private:
  struct Info {
    int parent = -1, depth = 0;
    bool active = false;
    Vector3d normal = Vector3d::UnitZ();
    double band = 0.0;
    std::vector<int> children, twists;
  };

  /// Share of x that follows joint j rather than its parent.
  double gate(int j, const Vector3d& x) const {
    const double s = (x - body_.joints[j].position).dot(joints_[j].normal);
    return smoothstep(0.0, 1.0, 0.5 + 0.5 * s / joints_[j].band);
  }

  /// 1 near the bone of j, 0 far from it, relative to its radius.
  double nearness(int j, const Vector3d& x) const {
    const BodyJoint& joint = body_.joints[j];
    const double d = segment_distance(x, joint.position, joint.tail);
    return 1.0 - smoothstep(0.0, 1.0, (d / std::max(joint.radius, 1e-9) - 1.3) / 0.9);
  }

  void pass_down(int j, double amount, const Vector3d& x, int hops, Row& row) const {
    double total = 0.0;
    std::vector<std::pair<int, double>> shares;
    if (hops > 0 && amount > 1e-4) {
      for (int c : joints_[j].children) {
        const double share = gate(c, x) * nearness(c, x);
        if (share > 1e-4) shares.emplace_back(c, share);
        total += share;
      }
    }
    const double scale = total > 1.0 ? 1.0 / total : 1.0;
    for (const auto& [c, share] : shares) pass_down(c, amount * share * scale, x, hops - 1, row);
    add(row, j, amount * std::max(0.0, 1.0 - total * scale));
  }

  void weigh(int owner, double amount, const Vector3d& x, Row& row) const {
    int j = owner;
    double left = amount;
    for (int hop = 0; hop < kHops && joints_[j].parent >= 0; ++hop) {
      const int parent = joints_[j].parent;
      const double back = left * (1.0 - gate(j, x)) * nearness(parent, x);
      if (hop == 0) {
        pass_down(j, left - back, x, 2, row);
      } else {
        add(row, j, left - back);
      }
      left = back;
      j = parent;
      if (left < 1e-4) break;
    }
    if (j == owner) {
      pass_down(j, left, x, 2, row);
    } else {
      add(row, j, left);
    }
  }

  int active(int j) const {
    while (!joints_[j].active && body_.joints[j].parent >= 0) j = body_.joints[j].parent;
    return j;
  }

  Row initial(std::size_t v) {
    const Vector3d& x = surface_.vertices[v];
    const Primitive& best = nearest_primitive(body_, surface_, v);
    Row row;
    if (best.owners.empty()) {
      owners_[v] = active(best.joint);
      weigh(owners_[v], 1.0, x, row);
      return row;
    }
    shared_[v] = true;
    // A sheet between bones follows each according to how near it is.
    double total = 0.0, largest = -1.0;
    Row shares;
    for (int j : best.owners) {
      const BodyJoint& joint = body_.joints[j];
      const double d = std::max(segment_distance(x, joint.position, joint.tail), 0.25 * joint.radius);
      const double share = 1.0 / (d * d * d);
      shares.emplace_back(active(j), share);
      total += share;
      if (share > largest) {
        largest = share;
        owners_[v] = active(j);
      }
    }
    for (const auto& [j, share] : shares) {
      if (share > 0.02 * total) weigh(j, share / total, x, row);
    }
    return row;
  }

  void neighbours() {
    adjacency_.resize(surface_.vertices.size());
    for (const Triangle& t : surface_.faces) {
      for (int k = 0; k < 3; ++k) adjacency_[t[k]].push_back(t[(k + 1) % 3]);
    }
  }

  /// True when one of the joints is an ancestor of the other, at most kHops away.
  bool related(int a, int b) const {
    if (joints_[a].depth > joints_[b].depth) std::swap(a, b);
    if (joints_[b].depth - joints_[a].depth > kHops) return false;
    while (joints_[b].depth > joints_[a].depth) b = joints_[b].parent;
    return a == b;
  }

  std::vector<Row> diffuse(const std::vector<Row>& rows) const {
    std::vector<Row> result(rows.size());
    for (std::size_t v = 0; v < rows.size(); ++v) {
      Row& row = result[v];
      for (const auto& [j, w] : rows[v]) add(row, j, 0.5 * w);
      const double share = 0.5 / static_cast<double>(adjacency_[v].size());
      for (int n : adjacency_[v]) {
        for (const auto& [j, w] : rows[n]) {
          // A vertex keeps the weight of joints that may not move it, so that rows go on summing to one.
          const bool known =
              std::any_of(rows[v].begin(), rows[v].end(), [j = j](const auto& e) { return e.first == j; });
          add(row, known || related(owners_[v], j) ? j : rows[v].front().first, share * w);
        }
      }
    }
    return result;
  }

  /// Weight of joints on another limb than the heaviest joint's goes to where the limbs meet, or to the heaviest joint
  /// when that is too far away.
  void keep_to_one_limb(Row& row) const {
    const int heaviest = std::max_element(row.begin(), row.end(), [](const auto& a, const auto& b) {
                           return a.second < b.second;
                         })->first;
    Row kept;
    for (const auto& [j, w] : row) {
      int to = j;
      while (to != heaviest && !related(to, heaviest) && joints_[to].parent >= 0) to = joints_[to].parent;
      add(kept, related(to, heaviest) ? to : heaviest, w);
    }
    row = std::move(kept);
  }

  std::vector<Influence> finish(std::size_t v, const Row& row, double least) const {
    double total = 0.0;
    for (const auto& [j, w] : row) total += w;
    std::vector<Influence> result;
    for (const auto& [j, w] : row) {
      if (w < least * total) continue;
      double own = w;
      const auto& twists = joints_[j].twists;
      if (!twists.empty()) {
        // n helpers cut the bone into n + 1 parts; weight passes linearly from one centre to the next.
        const BodyJoint& bone = body_.joints[j];
        const Vector3d along = bone.tail - bone.position;
        const double t = (surface_.vertices[v] - bone.position).dot(along) / along.squaredNorm();
        const double n = static_cast<double>(twists.size());
        const double at = std::clamp(t * (n + 1.0) - 0.5, 0.0, n);
        for (std::size_t k = 0; k < twists.size(); ++k) {
          const double share = w * std::max(0.0, 1.0 - std::abs(at - static_cast<double>(k + 1)));
          if (share > 1e-3) {
            result.push_back({twists[k], static_cast<float>(share)});
            own -= share;
          }
        }
      }
      if (own > 1e-3) result.push_back({j, static_cast<float>(own)});
    }
    return result;
  }

  const Body& body_;
  const Surface& surface_;
  std::vector<Info> joints_;
  std::vector<int> owners_;
  std::vector<bool> shared_;  ///< lies on a sheet between limbs
  std::vector<std::vector<int>> adjacency_;
};

}  // namespace

SkinWeights paint_weights(const Body& body, const Surface& surface) { return Painter(body, surface).run(); }

}  // namespace anigen::creatures
