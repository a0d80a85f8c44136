#include "anigen/asset/skin_weights.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"

namespace anigen {

namespace {

bool heavier(const Influence& a, const Influence& b) {
  return a.weight != b.weight ? a.weight > b.weight : a.joint < b.joint;
}

constexpr double kSmallestSum = 1e-8;

void check_joint(int joint, std::size_t joints, std::size_t vertex) {
  if (joint >= 0 && at(joint) < joints) return;
  throw InputError("", "skin row " + std::to_string(vertex),
                   "joint " + std::to_string(joint) + " is not one of the " + std::to_string(joints) + " joints");
}

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
    if (at(edge[1]) >= vertices)
      throw InputError("", "skin", "there is no row for vertex " + std::to_string(edge[1]) + " of the mesh");
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
      for (std::size_t n = neighbours.offsets[v]; n < neighbours.offsets[v + 1]; ++n)
        filled_neighbours += filled[at(neighbours.indices[n])] != 0;
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

/// Contribution of one block of joints to the rows, vertex by vertex.
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

std::size_t SkinWeights::largest_row() const {
  std::size_t largest = 0;
  for (std::size_t v = 0; v < rows(); ++v) largest = std::max(largest, row_size(v));
  return largest;
}

bool SkinWeights::append_row(std::vector<Influence> row) {
  row.erase(std::remove_if(row.begin(), row.end(),
                           [](const Influence& i) { return !(i.weight > 0.0f) || !std::isfinite(i.weight); }),
            row.end());
  std::sort(row.begin(), row.end(), [](const Influence& a, const Influence& b) { return a.joint < b.joint; });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (kept > 0 && row[kept - 1].joint == row[i].joint)
      row[kept - 1].weight += row[i].weight;
    else
      row[kept++] = row[i];
  }
  row.resize(kept);
  double sum = 0.0;
  for (const Influence& i : row) sum += i.weight;
  std::sort(row.begin(), row.end(), heavier);
  for (const Influence& i : row) {
    // Weights below the smallest float after the division carry no information.
    const auto weight = static_cast<float>(i.weight / sum);
    if (weight > 0.0f) influences.push_back({i.joint, weight});
  }
  offsets.push_back(influences.size());
  return !row.empty();
}

void SkinWeights::append_copy(const SkinWeights& other, std::size_t row) {
  influences.insert(influences.end(), other.row(row), other.row(row) + other.row_size(row));
  offsets.push_back(influences.size());
}

SkinWeights limit_influences(const SkinWeights& weights, std::size_t count) {
  SkinWeights limited;
  for (std::size_t v = 0; v < weights.rows(); ++v) {
    const Influence* row = weights.row(v);
    const std::size_t kept = std::min(count, weights.row_size(v));
    // A complete row is copied as it is: dividing by a sum of 1 ± an ulp would change it.
    if (kept == weights.row_size(v)) {
      limited.append_copy(weights, v);
    } else {
      limited.append_row({row, row + kept});
    }
  }
  return limited;
}

std::vector<float> to_dense(const SkinWeights& weights, std::size_t joints) {
  std::vector<float> dense(weights.rows() * joints, 0.0f);
  for (std::size_t v = 0; v < weights.rows(); ++v) {
    for (std::size_t i = 0; i < weights.row_size(v); ++i) {
      const Influence& influence = weights.row(v)[i];
      dense[v * joints + static_cast<std::size_t>(influence.joint)] = influence.weight;
    }
  }
  return dense;
}

SkinWeights from_dense(const std::vector<float>& dense, std::size_t rows, std::size_t joints, float threshold,
                       std::size_t* unweighted) {
  SkinWeights weights;
  std::size_t empty = 0;
  std::vector<Influence> row;
  for (std::size_t v = 0; v < rows; ++v) {
    row.clear();
    for (std::size_t j = 0; j < joints; ++j) {
      const float weight = dense[v * joints + j];
      if (weight > threshold) row.push_back({static_cast<std::int32_t>(j), weight});
    }
    if (row.empty()) {
      row.push_back({0, 1.0f});
      ++empty;
    }
    weights.append_row(row);
  }
  if (unweighted != nullptr) *unweighted = empty;
  return weights;
}

int published_max_hops(std::size_t joints) { return 2 * std::max(1, static_cast<int>(joints / 10)); }

SkinWeights filter_skin(const SkinWeights& skin, const std::vector<std::vector<int>>& hops, int max_hops,
                        const std::vector<int>& anchors) {
  const std::size_t joints = hops.size();
  if (joints == 0) throw InputError("", "hops", "there are no joints");
  for (const std::vector<int>& row : hops) {
    if (row.size() != joints) throw InputError("", "hops", "must have as many columns as rows");
  }
  if (!anchors.empty() && anchors.size() != skin.rows()) {
    throw InputError("", "anchors",
                     std::to_string(anchors.size()) + " anchors for " + std::to_string(skin.rows()) + " vertices");
  }
  SkinWeights filtered;
  filtered.offsets.reserve(skin.rows() + 1);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    const Influence* row = skin.row(v);
    // Rows begin with their heaviest influence.
    const int heaviest = skin.row_size(v) > 0 ? row[0].joint : 0;
    const int anchor = anchors.empty() ? heaviest : anchors[v];
    check_joint(anchor, joints, v);
    std::vector<Influence> kept;
    double sum = 0.0;
    for (std::size_t i = 0; i < skin.row_size(v); ++i) {
      check_joint(row[i].joint, joints, v);
      if (hops[at(anchor)][at(row[i].joint)] > max_hops) continue;
      kept.push_back(row[i]);
      sum += row[i].weight;
    }
    if (!(sum > kSmallestSum)) kept.assign(1, {anchor, 1.0f});
    filtered.append_row(std::move(kept));
  }
  return filtered;
}

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
