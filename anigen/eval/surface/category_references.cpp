#include "anigen/eval/surface/category_references.h"

#include <cmath>
#include <limits>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"
#include "anigen/core/random.h"
#include "anigen/eval/surface/surface_samples.h"

namespace anigen::eval {
namespace {

constexpr std::size_t kSamples = 512;

/// Samples of a surface whose bounding box is centred at 0 and has a longest side of 1.
Eigen::Matrix3Xf normalized_samples(const Mesh& mesh, std::uint64_t seed) {
  const SurfaceSamples samples = sample_mesh(mesh, kSamples, seed, "category references");
  Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(kSamples));
  for (std::size_t i = 0; i < kSamples; ++i) points.col(static_cast<Eigen::Index>(i)) = samples.points[i];
  // The box of the vertices in use would follow a stray one; that of the samples is what is compared.
  const Eigen::Vector3d low = points.rowwise().minCoeff(), high = points.rowwise().maxCoeff();
  const double side = (high - low).maxCoeff();
  if (!(side > 0)) throw InputError("", "", "the surface has no extent");
  return ((points.colwise() - (low + high) / 2) / side).cast<float>();
}

/// ½ mean_a d(a, B), given up beyond `most`, where it returns something larger than that.
double half_distance(const Eigen::Matrix3Xf& a, const Eigen::Matrix3Xf& b, double most) {
  const double share = 0.5 / static_cast<double>(a.cols());
  double sum = 0;
  for (Eigen::Index i = 0; i < a.cols() && sum <= most; ++i)
    sum += share * std::sqrt(static_cast<double>((b.colwise() - a.col(i)).colwise().squaredNorm().minCoeff()));
  return sum;
}

}  // namespace

CategoryReferences::CategoryReferences(const io::ShapeSource& source, const std::vector<std::string>& ids,
                                       std::uint64_t seed)
    : seed_(seed) {
  std::vector<Reference> all(ids.size());
  Progress progress("reading categories", ids.size(), "shapes");
  parallel_for(ids.size(), [&](std::size_t i) {
    if (interrupt_requested()) return;
    progress.advance();
    const std::string category = source.category(ids[i]);
    if (category.empty()) return;
    try {
      const io::RiggedShape shape = source.read(ids[i]);
      if (shape.has_surface()) all[i] = {ids[i], category, normalized_samples(shape.mesh, seed)};
    } catch (const InputError& problem) {
      log::warn("{} is no reference of a category: {}", ids[i], problem.what());
    }
  });
  progress.finish();
  throw_if_interrupted();
  for (Reference& reference : all) {
    if (!reference.category.empty()) references_.push_back(std::move(reference));
  }
}

CategoryReferences::Match CategoryReferences::nearest(const Mesh& mesh, const std::string& excluded) const {
  const Eigen::Matrix3Xf points = normalized_samples(mesh, seed_);
  double least = std::numeric_limits<double>::infinity();
  const Reference* nearest = nullptr;
  for (const Reference& reference : references_) {
    if (reference.id == excluded) continue;
    double distance = half_distance(points, reference.points, least);
    if (distance < least) distance += half_distance(reference.points, points, least - distance);
    if (distance >= least) continue;
    least = distance;
    nearest = &reference;
  }
  if (nearest == nullptr) throw InputError("", excluded, "there is no other shape to tell its category by");
  return {nearest->id, nearest->category, least};
}

Json CategoryReferences::describe() const {
  std::uint64_t hash = 0;
  for (const Reference& reference : references_) {
    hash = stable_hash(reference.id + "\n" + reference.category, hash);
    const auto* bytes = reinterpret_cast<const char*>(reference.points.data());
    hash = stable_hash({bytes, static_cast<std::size_t>(reference.points.size()) * sizeof(float)}, hash);
  }
  return {{"references", references_.size()}, {"samples", kSamples}, {"seed", seed_}, {"hash", std::to_string(hash)}};
}

}  // namespace anigen::eval
