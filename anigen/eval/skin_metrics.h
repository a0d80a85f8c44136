#pragma once
#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace anigen::eval {

/// Added to both weights inside the logarithm of the divergence (reference training-and-data.md, 7.4).
inline constexpr double kKlEpsilon = 1e-8;

/// Vertices are also scored by how many joints truly move them: 1, 2, 3, 4, and 5 or more.
inline constexpr std::size_t kInfluenceClasses = 5;

/// Distances between predicted and true skin weights, W and Ŵ, each averaged over vertices:
///   l1 = Σ_j |Ŵ_vj − W_vj|            a sum over joints, so between 0 and 2
///   l2 = (Σ_j (Ŵ_vj − W_vj)²)^½       a norm over joints, so between 0 and √2
///   kl = Σ_j W_vj log((W_vj + ε) / (Ŵ_vj + ε)), natural logarithm, ground truth first
struct SkinScore {
  double l1 = 0, l2 = 0, kl = 0;
};

struct SkinScores {
  SkinScore mean;                                            ///< over all vertices
  std::array<SkinScore, kInfluenceClasses> by_influences;    ///< over the vertices of one class
  std::array<std::size_t, kInfluenceClasses> class_sizes{};  ///< vertices in each class
};

/// @param predicted, truth row-major [V, J], finite, not negative, rows summing to 1
/// @return all zeros when there are no vertices
SkinScores score_skin(const std::vector<float>& predicted, const std::vector<float>& truth, std::size_t vertices,
                      std::size_t joints);

/// The l1 of every vertex, [V], for pictures.
std::vector<float> vertex_l1(const std::vector<float>& predicted, const std::vector<float>& truth, std::size_t vertices,
                             std::size_t joints);

/// Makes weights from a file fit for scoring: rows are divided by their sum.
/// @return how many rows were off by more than 1e-3
/// @throws InputError naming row and joint for a negative or not finite weight, or a row without any
std::size_t normalize_rows(std::vector<float>& dense, std::size_t rows, std::size_t joints, const std::string& file);

}  // namespace anigen::eval
