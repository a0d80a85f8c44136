#include "anigen/asset/skin_smoothing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"

namespace anigen {
namespace {

constexpr float kSmallestWeight = 1e-7f;
/// Columns that are smoothed together: one cache line per vertex.
constexpr std::size_t kBlock = 16;
using Block = std::vector<std::array<float, kBlock>>;  // [V]

struct Neighbours {
  std::vector<std::size_t> offsets;   ///< [V + 1]
  std::vector<std::int32_t> indices;  ///< ascending within a vertex

  std::size_t count(std::size_t v) const { return offsets[v + 1] - offsets[v]; }
};

Neighbours neighbours_of(const MeshEdges& edges, std::size_t vertices) {
  Neighbours result;
  result.offsets.assign(vertices + 1, 0);
  for (const MeshEdges::Edge& edge : edges.all()) {
    if (at(edge[1]) >= vertices) {
      throw InputError("", "skin", "there is no row for vertex " + std::to_string(edge[1]) + " of the mesh");
    }
    for (const std::int32_t v : edge) ++result.offsets[at(v) + 1];
  }
  for (std::size_t v = 0; v < vertices; ++v) result.offsets[v + 1] += result.offsets[v];
  result.indices.resize(result.offsets.back());
  std::vector<std::size_t> next(result.offsets.begin(), result.offsets.end() - 1);
  for (const MeshEdges::Edge& edge : edges.all()) {
    result.indices[next[at(edge[0])]++] = edge[1];
    result.indices[next[at(edge[1])]++] = edge[0];
  }
  return result;
}

/// Factors of one iteration for every vertex, normalisation included.
struct Step {
  std::vector<float> own, others;  ///< [V]
};

/// A row that is not empty sums to 1 after each iteration, so its next sum follows from which rows are empty, without
/// looking at weights: that is what lets joints be smoothed independently of each other.
/// Steps repeat once no empty row is left to fill; the last one then stands for all that follow.
std::vector<Step> plan_steps(const Neighbours& neighbours, std::vector<char> filled, const SkinSmoothing& options) {
  const auto alpha = static_cast<float>(std::min(options.alpha, 1.0));
  std::vector<Step> steps;
  for (int i = 0; i < options.iterations; ++i) {
    std::vector<char> next(filled.size(), 0);
    Step step{std::vector<float>(filled.size(), 0.0f), std::vector<float>(filled.size(), 0.0f)};
    for (std::size_t v = 0; v < filled.size(); ++v) {
      const std::size_t degree = neighbours.count(v);
      std::size_t filled_neighbours = 0;
      for (std::size_t n = neighbours.offsets[v]; n < neighbours.offsets[v + 1]; ++n) {
        filled_neighbours += filled[at(neighbours.indices[n])] != 0;
      }
      float own = 1.0f - alpha;
      if (degree == 0 && !options.empties_isolated) own = 1.0f;
      const float others = degree > 0 ? alpha / static_cast<float>(degree) : 0.0f;
      const float sum = (filled[v] != 0 ? own : 0.0f) + others * static_cast<float>(filled_neighbours);
      if (!(sum > 0.0f)) continue;
      next[v] = 1;
      step.own[v] = own / sum;
      step.others[v] = others / sum;
    }
    const bool repeats = next == filled;
    filled = std::move(next);
    steps.push_back(std::move(step));
    if (repeats) break;
  }
  return steps;
}

void apply(const Step& step, const Neighbours& neighbours, const Block& from, Block& to) {
  for (std::size_t v = 0; v < from.size(); ++v) {
    std::array<float, kBlock> sum{};
    for (std::size_t n = neighbours.offsets[v]; n < neighbours.offsets[v + 1]; ++n) {
      const std::array<float, kBlock>& other = from[at(neighbours.indices[n])];
      for (std::size_t k = 0; k < kBlock; ++k) sum[k] += other[k];
    }
    for (std::size_t k = 0; k < kBlock; ++k) to[v][k] = step.own[v] * from[v][k] + step.others[v] * sum[k];
  }
}

/// Columns [first, first + kBlock) of the weights; false when they are all zero.
bool fill(Block& block, const SkinWeights& skin, std::size_t first) {
  bool any = false;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    block[v].fill(0.0f);
    for (std::size_t i = 0; i < skin.row_size(v); ++i) {
      const Influence& influence = skin.row(v)[i];
      const std::size_t joint = at(influence.joint);
      if (joint < first || joint >= first + kBlock) continue;
      block[v][joint - first] = influence.weight;
      any = true;
    }
  }
  return any;
}

/// What one block of joints contributes to the rows, vertex by vertex.
struct Part {
  std::vector<std::size_t> offsets;  ///< [V + 1], or empty for a block without weights
  std::vector<Influence> influences;
};

Part smoothed_block(const SkinWeights& skin, const Neighbours& neighbours, const std::vector<Step>& steps,
                    int iterations, std::size_t first) {
  Part part;
  Block block(skin.rows());
  if (!fill(block, skin, first)) return part;
  Block next(skin.rows());
  for (std::size_t i = 0; i < static_cast<std::size_t>(iterations); ++i) {
    apply(steps[std::min(i, steps.size() - 1)], neighbours, block, next);
    std::swap(block, next);
  }
  part.offsets.push_back(0);
  for (const std::array<float, kBlock>& row : block) {
    for (std::size_t k = 0; k < kBlock; ++k) {
      if (row[k] >= kSmallestWeight) part.influences.push_back({static_cast<std::int32_t>(first + k), row[k]});
    }
    part.offsets.push_back(part.influences.size());
  }
  return part;
}

void check(const SkinWeights& skin, std::size_t joints, const SkinSmoothing& options) {
  if (options.iterations < 0) throw InputError("", "iterations", "must be at least 0");
  if (!(options.alpha >= 0.0)) throw InputError("", "alpha", "must be a number of at least 0");
  for (const Influence& influence : skin.influences) {
    if (influence.joint >= 0 && at(influence.joint) < joints) continue;
    throw InputError("", "skin", "there is no joint " + std::to_string(influence.joint));
  }
}

}  // namespace

SkinWeights smooth_skin(const SkinWeights& skin, const MeshEdges& edges, std::size_t joints,
                        const SkinSmoothing& options) {
  check(skin, joints, options);
  const Neighbours neighbours = neighbours_of(edges, skin.rows());
  if (options.iterations == 0) return skin;
  std::vector<char> filled(skin.rows());
  for (std::size_t v = 0; v < skin.rows(); ++v) filled[v] = skin.row_size(v) > 0;
  const std::vector<Step> steps = plan_steps(neighbours, std::move(filled), options);
  std::vector<Part> parts((joints + kBlock - 1) / kBlock);
  parallel_for(parts.size(), [&](std::size_t b) {
    parts[b] = smoothed_block(skin, neighbours, steps, options.iterations, b * kBlock);
  });
  SkinWeights smoothed;
  smoothed.offsets.reserve(skin.rows() + 1);
  std::vector<Influence> row;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    row.clear();
    for (const Part& part : parts) {
      if (part.offsets.empty()) continue;
      const auto begin = part.influences.begin();
      row.insert(row.end(), begin + static_cast<std::ptrdiff_t>(part.offsets[v]),
                 begin + static_cast<std::ptrdiff_t>(part.offsets[v + 1]));
    }
    smoothed.append_row(row);
  }
  return smoothed;
}

}  // namespace anigen
