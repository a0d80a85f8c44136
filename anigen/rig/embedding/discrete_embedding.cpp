#include "anigen/rig/embedding/discrete_embedding.h"

#include <algorithm>
#include <limits>
#include <queue>
#include <utility>

#include "anigen/core/interrupt.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"

namespace anigen::rig {
namespace {

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
  EmbeddingSearch(const SphereGraph& graph, const ReducedSkeleton& skeleton, const EmbeddingOptions& options)
      : graph_(graph),
        skeleton_(skeleton),
        options_(options),
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
    return false;
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
  EmbeddingPenalties penalties_;
  SubtreeBounds bounds_;
  std::vector<std::vector<std::vector<float>>> lone_rows_;  ///< [joint][vertex of its parent + 1][candidate]
  std::vector<SearchState> states_;
  std::size_t expanded_ = 0;
  bool strict_ = true;
};

}  // namespace

DiscreteEmbedding discrete_embedding(const SphereGraph& graph, const ReducedSkeleton& skeleton,
                                     const EmbeddingOptions& options) {
  return EmbeddingSearch(graph, skeleton, options).run();
}

}  // namespace anigen::rig
