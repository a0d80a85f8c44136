#include "anigen/eval/skin/skin_matrix.h"

#include <string>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

void check_size(std::size_t found, std::size_t vertices, std::size_t joints) {
  if (joints != 0 && vertices > static_cast<std::size_t>(-1) / joints)
    throw InputError("", "skin", "too many vertices and joints");
  if (found != vertices * joints) {
    throw InputError("", "skin",
                     std::to_string(found) + " weights for " + std::to_string(vertices) + " vertices and " +
                         std::to_string(joints) + " joints");
  }
}

void check_entries(const SkinMatrixView& weights, const char* which) {
  for (Eigen::Index v = 0; v < weights.rows(); ++v) {
    // Written so that NaN fails too.
    if (weights.row(v).minCoeff() >= 0.0 && weights.row(v).allFinite()) continue;
    throw InputError("", std::string(which) + ", vertex " + std::to_string(v), "a weight is negative or not finite");
  }
}

}  // namespace

Eigen::Map<const SkinMatrix> skin_matrix(const std::vector<double>& dense, std::size_t vertices, std::size_t joints) {
  check_size(dense.size(), vertices, joints);
  return {dense.data(), static_cast<Eigen::Index>(vertices), static_cast<Eigen::Index>(joints)};
}

SkinMatrix skin_matrix(const std::vector<float>& dense, std::size_t vertices, std::size_t joints) {
  check_size(dense.size(), vertices, joints);
  SkinMatrix result(vertices, joints);
  for (std::size_t i = 0; i < dense.size(); ++i) result.data()[i] = dense[i];
  return result;
}

void check_skin_pair(const SkinMatrixView& predicted, const SkinMatrixView& truth) {
  if (predicted.rows() != truth.rows() || predicted.cols() != truth.cols()) {
    throw InputError("", "skin",
                     "predicted weights are " + std::to_string(predicted.rows()) + " x " +
                         std::to_string(predicted.cols()) + ", true ones " + std::to_string(truth.rows()) + " x " +
                         std::to_string(truth.cols()));
  }
  if (truth.size() == 0) throw InputError("", "skin", "there is no vertex or no joint");
  check_entries(predicted, "predicted skin");
  check_entries(truth, "true skin");
}

}  // namespace anigen::eval
