#include "anigen/rigging/pinocchio_discrete.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <numeric>
#include <queue>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"

namespace anigen::rigging {

void check(const EmbeddingOptions& options) {
  const auto require = [](bool good, const char* name, const char* range) {
    if (!good) throw InputError("", std::string("embedding.") + name, std::string("must be ") + range);
  };
  require(options.size > 0.0 && std::isfinite(options.size), "size", "positive");
  require(options.resolution >= 8 && options.resolution <= 512, "resolution", "8 to 512");
  require(options.tolerance >= 0.0 && std::isfinite(options.tolerance), "tolerance", "0 or more");
  require(options.most_spheres >= 1 && options.most_spheres <= 4000, "most_spheres", "1 to 4000");
  require(options.fat_candidates >= 1, "fat_candidates", "1 or more");
  require(options.most_states >= 1, "most_states", "1 or more");
  require(options.beam_width >= 1, "beam_width", "1 or more");
  require(options.most_stretch >= 1.0 && std::isfinite(options.most_stretch), "most_stretch", "1 or more");
  require(options.refinement_rounds >= 0, "refinement_rounds", "0 or more");
  for (const double weight :
       {options.length_weight, options.direction_weight, options.symmetry_weight, options.doubled_weight,
        options.foot_weight, options.duplicate_weight, options.local_direction_weight, options.extremity_weight,
        options.disjoint_weight, options.surface_weight, options.bone_length_weight, options.bone_angle_weight,
        options.bone_symmetry_weight, options.stretch_weight}) {
    require(weight >= 0.0 && std::isfinite(weight), "weights", "0 or more");
  }
}

namespace {

/// S(x; a → at_a, b → at_b): on a line between the two, and level beyond.
double ramp(double x, double a, double at_a, double b, double at_b) {
  const double t = std::clamp((x - a) / (b - a), 0.0, 1.0);
  return at_a + t * (at_b - at_a);
}

double square(double x) { return x * x; }
double cube(double x) { return x * x * x; }

/// Cosine of the angle between two directions; 1 where one has no length, which says nothing against it.
double cosine(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const double lengths = a.norm() * b.norm();
  return lengths > 1e-12 ? std::clamp(a.dot(b) / lengths, -1.0, 1.0) : 1.0;
}

constexpr double kThinnestShared = 0.02;  // radius of a sphere that two bones may pass

/// Extra cost of a step that breaks a rule: a search that obeys rules takes no step that costs this much.
constexpr double kBrokenRule = 1.0;

/// A partial embedding: the vertices of the first joints, and what follows from them.
struct PlacedJoints {
  std::vector<int> vertices;                   ///< [k], of the first k reduced joints
  std::vector<char> used;                      ///< [V], on the way of a bone
  std::vector<std::vector<double>> tree_path;  ///< [k][k], lengths of ways along the bones
};

PlacedJoints placed_so_far(const SphereGraph& graph, const ReducedSkeleton& skeleton, std::vector<int> vertices) {
  PlacedJoints placed;
  placed.used.assign(graph.size(), 0);
  placed.tree_path.assign(vertices.size(), std::vector<double>(vertices.size(), 0.0));
  for (std::size_t k = 0; k < vertices.size(); ++k) {
    placed.used[at(vertices[k])] = 1;
    const int parent = skeleton.joints[k].parent;
    if (parent < 0) continue;
    const int u = vertices[at(parent)];
    for (int w = vertices[k]; w >= 0; w = graph.before(u, w)) placed.used[at(w)] = 1;
    for (std::size_t i = 0; i < k; ++i) {
      placed.tree_path[i][k] = placed.tree_path[k][i] =
          placed.tree_path[at(parent)][i] + graph.distance(u, vertices[k]);
    }
  }
  placed.vertices = std::move(vertices);
  return placed;
}

/// The nine penalties of the discrete embedding, by their numbers in the reference (docs/reference/riggers.md, 2, step
/// 7), weighted and summed. S(x; a → A, b → B) is ramp().
class EmbeddingPenalties {
 public:
  /// Keeps references to all three.
  EmbeddingPenalties(const SphereGraph& graph, const ReducedSkeleton& skeleton, const EmbeddingOptions& options)
      : graph_(graph), skeleton_(skeleton), options_(options) {
    for (int v = 0; at(v) < graph.size(); ++v) {
      lowest_ = std::min(lowest_, graph[v].center.z());
      extremity_.push_back(is_extremity(v) ? 1 : 0);
    }
  }

  /// Vertices where a joint may lie (stage 6); where no vertex qualifies, all.
  std::vector<int> candidates(std::size_t joint) const {
    const ReducedJoint& wanted = skeleton_.joints[joint];
    std::vector<int> all(graph_.size());
    std::iota(all.begin(), all.end(), 0);
    if (wanted.fat) {
      // The packing took the largest spheres first.
      all.resize(std::min(all.size(), options_.fat_candidates));
      return all;
    }
    if (!wanted.leaf) return all;
    std::vector<int> ends;
    std::copy_if(all.begin(), all.end(), std::back_inserter(ends), [&](int v) { return extremity_[at(v)] != 0; });
    return ends.empty() ? all : ends;
  }

  /// Joint `joint` at vertex v without regard to other joints than its parent, which is at u. The first joint has only
  /// its height as a foot.
  double lone(std::size_t joint, int u, int v) const {
    const ReducedJoint& placed = skeleton_.joints[joint];
    double sum = options_.foot_weight * foot_height(placed, v);
    if (placed.parent < 0) return sum;
    sum += options_.length_weight * length(placed, u, v);
    sum += options_.direction_weight * parent_direction(placed, u, v);
    sum += options_.duplicate_weight * (u == v ? 1.0 : 0.0);
    sum += options_.local_direction_weight * local_direction(placed, u, v);
    sum += options_.extremity_weight * (placed.leaf && goes_farther(u, v) ? 1.0 : 0.0);
    return sum;
  }

  /// Penalties from the joints placed before.
  double together(std::size_t joint, int v, const PlacedJoints& placed) const {
    const ReducedJoint& here = skeleton_.joints[joint];
    if (here.parent < 0) return 0.0;
    const int u = placed.vertices[at(here.parent)];
    return options_.direction_weight * sibling_directions(joint, v, placed) +
           options_.symmetry_weight * symmetry(here, u, v, placed) +
           options_.doubled_weight * doubled_way(u, v, placed) +
           options_.disjoint_weight * disjointness(joint, v, placed);
  }

 private:
  /// Stage 6: for some neighbour e₁ no neighbour e₂ with r_v ≤ 2 r_e₂ goes on in about the same direction (dot > 0.8).
  bool is_extremity(int v) const {
    const Sphere& here = graph_[v];
    const auto goes_on_from = [&](int before) {
      return std::any_of(graph_.neighbours(v).begin(), graph_.neighbours(v).end(), [&](int after) {
        return here.radius <= 2.0 * graph_[after].radius &&
               cosine(here.center - graph_[before].center, graph_[after].center - here.center) > 0.8;
      });
    };
    const auto& around = graph_.neighbours(v);
    return around.empty() ||
           std::any_of(around.begin(), around.end(), [&](int before) { return !goes_on_from(before); });
  }

  /// Slack of a path between two spheres: 0.7 (r_u + r_v).
  double play(int u, int v) const { return 0.7 * (graph_[u].radius + graph_[v].radius); }

  /// 1: S(L / (d + play); 0.5 → 0, 2 → 3)³ with L the length of the bone and d that of the path; broken below L / 2.
  double length(const ReducedJoint& joint, int u, int v) const {
    const double reach = graph_.distance(u, v) + play(u, v);
    const double broken = reach < 0.5 * joint.length ? kBrokenRule / options_.length_weight : 0.0;
    return broken + cube(ramp(joint.length / std::max(reach, 1e-9), 0.5, 0.0, 2.0, 3.0));
  }

  /// 2: ½ max(0, (4 (1 − dot))² − 0.1), dot between the embedded bone and the template's; broken below 0.
  double parent_direction(const ReducedJoint& joint, int u, int v) const {
    const Eigen::Vector3d wanted = joint.position - skeleton_.joints[at(joint.parent)].position;
    const double dot = cosine(graph_[v].center - graph_[u].center, wanted);
    const double broken = dot < 0.0 ? kBrokenRule / options_.direction_weight : 0.0;
    return broken + 0.5 * std::max(0.0, square(4.0 * (1.0 - dot)) - 0.1);
  }

  /// 2, from each sibling: ½ max(0, (2 (1 − dot))² − 0.5); broken below −0.5.
  double sibling_directions(std::size_t joint, int v, const PlacedJoints& placed) const {
    const ReducedJoint& here = skeleton_.joints[joint];
    double sum = 0.0;
    for (std::size_t i = 0; i < placed.vertices.size(); ++i) {
      if (skeleton_.joints[i].parent != here.parent) continue;
      const double dot =
          cosine(graph_[v].center - graph_[placed.vertices[i]].center, here.position - skeleton_.joints[i].position);
      if (dot < -0.5) sum += kBrokenRule / options_.direction_weight;
      sum += 0.5 * std::max(0.0, square(2.0 * (1.0 - dot)) - 0.5);
    }
    return sum;
  }

  /// 3: max(0, (0.2 noc + 0.8 ratio)³ − 1.2): noc compares the lengths of both sides' paths as they are, at most
  /// twofold, ratio with the play of their ends.
  double symmetry(const ReducedJoint& joint, int u, int v, const PlacedJoints& placed) const {
    if (joint.mirror < 0 || at(joint.mirror) >= placed.vertices.size()) return 0.0;
    const int other = placed.vertices[at(joint.mirror)];
    const int other_parent = skeleton_.joints[at(joint.mirror)].parent;
    if (other_parent < 0) return 0.0;
    const int other_start = placed.vertices[at(other_parent)];
    const double a = graph_.distance(u, v), b = graph_.distance(other_start, other);
    const double a_play = play(u, v), b_play = play(other_start, other);
    const double ratio = std::max(b / (a + a_play), a / (b + b_play));
    const double plain = a > 0.0 && b > 0.0 ? std::min(2.0, std::max(a / b, b / a)) : (a == b ? 1.0 : 2.0);
    return std::max(0.0, cube(0.2 * plain + 0.8 * ratio) - 1.2);
  }

  /// 4: ½, and 0.5 / (i + 1)² for each vertex at place i of the path from v that a bone uses already; broken where such
  /// a sphere is thin.
  double doubled_way(int u, int v, const PlacedJoints& placed) const {
    double sum = 0.0;
    int steps = 0;
    for (int w = v; w >= 0 && w != u; w = graph_.before(u, w), ++steps) {
      if (placed.used[at(w)] == 0) continue;
      sum += 0.5 / square(steps + 1.0);
      if (graph_[w].radius < kThinnestShared) sum += kBrokenRule / options_.doubled_weight;
    }
    return sum > 0.0 ? sum + 0.5 : 0.0;
  }

  /// 5: how high a foot stands above the lowest sphere.
  double foot_height(const ReducedJoint& joint, int v) const {
    return joint.foot ? graph_[v].center.z() - lowest_ : 0.0;
  }

  /// 7: the sum of local_bone() over the joints of the template along the path.
  double local_direction(const ReducedJoint& joint, int u, int v) const {
    const double total = graph_.distance(u, v);
    if (!(total > 0.0)) return 0.0;
    // Joints of the bone from its end back to its start, while the way is walked in the same direction.
    std::size_t c = joint.chain.size();
    Eigen::Vector3d end = graph_[v].center;
    double sum = 0.0;
    int w = v;
    while (c > 0) {
      const double fraction = c > 1 ? joint.fractions[c - 2] : 0.0;
      const double place = fraction * total;
      while (w != u && graph_.before(u, w) != u && graph_.distance(u, graph_.before(u, w)) > place)
        w = graph_.before(u, w);
      Eigen::Vector3d start = graph_[u].center;
      if (c > 1 && w != u) {
        const int before = graph_.before(u, w);
        const double from = graph_.distance(u, before), to = graph_.distance(u, w);
        const double t = to > from ? std::clamp((place - from) / (to - from), 0.0, 1.0) : 0.0;
        start = (1.0 - t) * graph_[before].center + t * graph_[w].center;
      }
      sum += local_bone(joint, c - 1, end - start);
      end = start;
      --c;
    }
    return sum;
  }

  /// 50 len² ((1 − dot) S(dot; −0.5 → 6, 0 → 1))².
  double local_bone(const ReducedJoint& joint, std::size_t link, const Eigen::Vector3d& embedded) const {
    const double dot = cosine(embedded, joint.directions[link]);
    return 50.0 * embedded.squaredNorm() * square((1.0 - dot) * ramp(dot, -0.5, 6.0, 0.0, 1.0));
  }

  /// 8: some neighbour o with r_v ≤ 2 r_o lies farther along (dot > 0.95 from u, > 0.8 from v).
  bool goes_farther(int u, int v) const {
    const Eigen::Vector3d along = graph_[v].center - graph_[u].center;
    return std::any_of(graph_.neighbours(v).begin(), graph_.neighbours(v).end(), [&](int o) {
      return graph_[v].radius <= 2.0 * graph_[o].radius && cosine(graph_[o].center - graph_[u].center, along) > 0.95 &&
             cosine(graph_[o].center - graph_[v].center, along) > 0.8;
    });
  }

  /// 9: joints i placed before with (tree path + s) / (graph distance + s) > 2, s = r_v + r_i.
  double disjointness(std::size_t joint, int v, const PlacedJoints& placed) const {
    const auto parent = at(skeleton_.joints[joint].parent);
    const int u = placed.vertices[parent];
    double sum = 0.0;
    for (std::size_t i = 0; i < placed.vertices.size(); ++i) {
      if (i == parent) continue;
      const int w = placed.vertices[i];
      const double slack = graph_[v].radius + graph_[w].radius;
      const double along = graph_.distance(u, v) + placed.tree_path[parent][i];
      if ((along + slack) / (graph_.distance(v, w) + slack) > 2.0) sum += 1.0;
    }
    return sum;
  }

  const SphereGraph& graph_;
  const ReducedSkeleton& skeleton_;
  const EmbeddingOptions& options_;
  double lowest_ = 1e300;  ///< z of the lowest sphere's centre
  std::vector<char> extremity_;
};

constexpr double kMostCost = 1.0;

/// Candidates of every joint, and bounds of what their subtrees cost.
class SubtreeBounds {
 public:
  SubtreeBounds(const EmbeddingPenalties& penalties, const ReducedSkeleton& skeleton, std::size_t vertices)
      : skeleton_(skeleton), best_(skeleton.joints.size(), std::vector<float>(vertices, 0.0F)) {
    const std::size_t joints = skeleton.joints.size();
    for (std::size_t k = 0; k < joints; ++k) candidates_.push_back(penalties.candidates(k));
    for (std::size_t k = joints; k-- > 1;) {
      const auto& parents = candidates_[at(skeleton.joints[k].parent)];
      parallel_for(parents.size(), [&](std::size_t i) {
        double least = std::numeric_limits<double>::infinity();
        for (const int v : candidates_[k]) {
          const double below = children(k, v);
          if (below < least) least = std::min(least, below + penalties.lone(k, parents[i], v));
        }
        best_[k][at(parents[i])] = static_cast<float>(least);
      });
    }
  }

  const std::vector<int>& candidates(std::size_t joint) const { return candidates_[joint]; }
  /// Least cost of a joint and all below it when its parent is at u.
  double best(std::size_t joint, int u) const { return static_cast<double>(best_[joint][at(u)]); }
  /// Least cost of all below a joint at v.
  double children(std::size_t joint, int v) const {
    double sum = 0.0;
    for (const int child : skeleton_.children[joint]) sum += best(at(child), v);
    return sum;
  }

 private:
  const ReducedSkeleton& skeleton_;
  std::vector<std::vector<int>> candidates_;
  std::vector<std::vector<float>> best_;  ///< [joint][vertex of its parent]
};

struct SearchState {
  double cost = 0.0;   ///< of the joints placed
  double bound = 0.0;  ///< least cost of an embedding that begins like this
  int before = -1;     ///< the state without the last joint
  int vertex = -1;     ///< of the last joint
  int depth = 0;       ///< joints placed
};

/// The tree of partial embeddings.
class EmbeddingSearch {
 public:
  EmbeddingSearch(const SphereGraph& graph, const ReducedSkeleton& skeleton, const EmbeddingOptions& options,
                  const std::atomic<double>* limit, double surcharge)
      : graph_(graph),
        skeleton_(skeleton),
        options_(options),
        limit_(limit),
        surcharge_(surcharge),
        penalties_(graph, skeleton, options),
        bounds_(penalties_, skeleton, graph.size()),
        lone_rows_(skeleton.joints.size(), std::vector<std::vector<float>>(graph.size() + 1)) {}

  DiscreteEmbedding run() {
    DiscreteEmbedding result;
    if (!best_first(result)) beam(result);
    result.states = expanded_;
    return result;
  }

 private:
  std::size_t joints() const { return skeleton_.joints.size(); }

  bool is_beyond_limit(double cost) const { return limit_ != nullptr && cost + surcharge_ > *limit_; }

  std::vector<int> vertices_of(const SearchState& state) const {
    std::vector<int> vertices(at(state.depth));
    const SearchState* s = &state;
    for (int k = state.depth; k-- > 0;) {
      vertices[at(k)] = s->vertex;
      if (s->before >= 0) s = &states_[at(s->before)];
    }
    return vertices;
  }

  /// Calls visit(state) for every way to place one joint more.
  template <typename Visit>
  void expand(int from, const Visit& visit) {
    if (++expanded_ % 64 == 0) throw_if_interrupted();
    const SearchState state = from >= 0 ? states_[at(from)] : SearchState{};
    const auto k = at(state.depth);
    const ReducedJoint& joint = skeleton_.joints[k];
    const PlacedJoints placed = placed_so_far(graph_, skeleton_, from >= 0 ? vertices_of(state) : std::vector<int>{});
    const int u = joint.parent >= 0 ? placed.vertices[at(joint.parent)] : -1;
    const double others = joint.parent >= 0 ? state.bound - bounds_.best(k, u) : 0.0;
    const std::vector<float>& lone_row = lone_penalties(k, u);
    for (std::size_t i = 0; i < lone_row.size(); ++i) {
      const int v = bounds_.candidates(k)[i];
      const double below = bounds_.children(k, v);
      const double lone = static_cast<double>(lone_row[i]);
      if (strict_ && (lone >= kMostCost || others + lone + below >= kMostCost)) continue;
      const double step = lone + penalties_.together(k, v, placed);
      if (strict_ && step >= kMostCost) continue;
      SearchState next;
      next.cost = state.cost + step;
      next.bound = std::max(next.cost, others + step + below);
      next.before = from;
      next.vertex = v;
      next.depth = state.depth + 1;
      visit(next);
    }
  }

  /// Of all candidates of a joint when its parent is at u; kept, since many states ask for the same.
  const std::vector<float>& lone_penalties(std::size_t joint, int u) {
    std::vector<float>& row = lone_rows_[joint][at(u + 1)];
    if (row.empty()) {
      for (const int v : bounds_.candidates(joint)) row.push_back(static_cast<float>(penalties_.lone(joint, u, v)));
    }
    return row;
  }

  bool best_first(DiscreteEmbedding& result) {
    strict_ = true;
    using Entry = std::pair<double, int>;  // of equal bounds the older state
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
    const auto keep = [&](const SearchState& state) {
      if (!(state.bound < kMostCost)) return;
      open.emplace(state.bound, static_cast<int>(states_.size()));
      states_.push_back(state);
    };
    expand(-1, keep);
    while (!open.empty() && expanded_ < options_.most_states) {
      if (is_beyond_limit(open.top().first)) {
        result.given_up = true;
        return true;
      }
      const int top = open.top().second;
      open.pop();
      if (at(states_[at(top)].depth) == joints()) {
        result.vertices = vertices_of(states_[at(top)]);
        result.penalty = states_[at(top)].cost;
        result.best = true;
        return true;
      }
      expand(top, keep);
    }
    // Whatever is left breaks a rule.
    result.given_up = open.empty() && is_beyond_limit(kMostCost);
    return result.given_up;
  }

  void beam(DiscreteEmbedding& result) {
    strict_ = false;
    states_.clear();
    std::vector<int> front{-1};
    for (std::size_t k = 0; k < joints(); ++k) {
      std::vector<SearchState> next;
      for (const int from : front) {
        expand(from, [&](const SearchState& state) { next.push_back(state); });
      }
      std::stable_sort(next.begin(), next.end(),
                       [](const SearchState& a, const SearchState& b) { return a.bound < b.bound; });
      if (next.size() > options_.beam_width) next.resize(options_.beam_width);
      front.clear();
      for (const SearchState& state : next) {
        front.push_back(static_cast<int>(states_.size()));
        states_.push_back(state);
      }
    }
    result.vertices = vertices_of(states_[at(front.front())]);
    result.penalty = states_[at(front.front())].cost;
  }

  const SphereGraph& graph_;
  const ReducedSkeleton& skeleton_;
  const EmbeddingOptions& options_;
  const std::atomic<double>* limit_;
  double surcharge_;
  EmbeddingPenalties penalties_;
  SubtreeBounds bounds_;
  std::vector<std::vector<std::vector<float>>> lone_rows_;  ///< [joint][vertex of its parent + 1][candidate]
  std::vector<SearchState> states_;
  std::size_t expanded_ = 0;
  bool strict_ = true;
};

}  // namespace

DiscreteEmbedding discrete_embedding(const SphereGraph& graph, const ReducedSkeleton& skeleton,
                                     const EmbeddingOptions& options, const std::atomic<double>* limit,
                                     double surcharge) {
  return EmbeddingSearch(graph, skeleton, options, limit, surcharge).run();
}

}  // namespace anigen::rigging
