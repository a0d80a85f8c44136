#include "anigen/eval/skin_metrics.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

void add(SkinScore& sum, const SkinScore& term) {
  sum.l1 += term.l1;
  sum.l2 += term.l2;
  sum.kl += term.kl;
}

void divide(SkinScore& sum, std::size_t n) {
  if (n == 0) return;
  sum.l1 /= static_cast<double>(n);
  sum.l2 /= static_cast<double>(n);
  sum.kl /= static_cast<double>(n);
}

}  // namespace

SkinScores score_skin(const std::vector<float>& predicted, const std::vector<float>& truth, std::size_t vertices,
                      std::size_t joints) {
  SkinScores scores;
  for (std::size_t v = 0; v < vertices; ++v) {
    const float* p = predicted.data() + v * joints;
    const float* t = truth.data() + v * joints;
    SkinScore row;
    double squares = 0;
    std::size_t influences = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      const double difference = static_cast<double>(p[j]) - t[j];
      row.l1 += std::abs(difference);
      squares += difference * difference;
      if (t[j] <= 0.0f) continue;
      ++influences;
      row.kl += t[j] * std::log((t[j] + kKlEpsilon) / (p[j] + kKlEpsilon));
    }
    row.l2 = std::sqrt(squares);
    add(scores.mean, row);
    if (influences == 0) continue;
    const std::size_t group = std::min(influences, kInfluenceClasses) - 1;
    add(scores.by_influences[group], row);
    ++scores.class_sizes[group];
  }
  divide(scores.mean, vertices);
  for (std::size_t k = 0; k < kInfluenceClasses; ++k) divide(scores.by_influences[k], scores.class_sizes[k]);
  return scores;
}

std::vector<float> vertex_l1(const std::vector<float>& predicted, const std::vector<float>& truth, std::size_t vertices,
                             std::size_t joints) {
  std::vector<float> result(vertices, 0.0f);
  for (std::size_t v = 0; v < vertices; ++v) {
    for (std::size_t i = v * joints; i < (v + 1) * joints; ++i) result[v] += std::abs(predicted[i] - truth[i]);
  }
  return result;
}

std::size_t normalize_rows(std::vector<float>& dense, std::size_t rows, std::size_t joints, const std::string& file) {
  std::size_t off = 0;
  for (std::size_t v = 0; v < rows; ++v) {
    float* row = dense.data() + v * joints;
    double sum = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      if (!std::isfinite(row[j]) || row[j] < 0.0f) {
        throw InputError(file, "skin[" + std::to_string(v) + ", " + std::to_string(j) + "]",
                         "a weight must be finite and not negative, got " + std::to_string(row[j]));
      }
      sum += row[j];
    }
    if (!(sum > 0.0)) throw InputError(file, "skin[" + std::to_string(v) + "]", "the row has no weight at all");
    off += std::abs(sum - 1.0) > 1e-3;
    for (std::size_t j = 0; j < joints; ++j) row[j] = static_cast<float>(row[j] / sum);
  }
  return off;
}

}  // namespace anigen::eval
