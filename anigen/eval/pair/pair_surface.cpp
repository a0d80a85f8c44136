#include "anigen/eval/pair/pair_groups.h"
#include "anigen/eval/surface/surface_metrics.h"

namespace anigen::eval {
namespace {

/// Whether anything but the renderer's grey would be seen.
bool has_colors(const io::RiggedShape& shape) {
  if (!shape.mesh.colors.empty()) return true;
  for (const Material& material : shape.materials) {
    if (material.image >= 0 || material.base_color != Eigen::Vector4f::Ones()) return true;
  }
  return false;
}

}  // namespace

void add_surface_metrics(const ComparedShapes& shapes, const PairSettings& settings, PairResult& result) {
  SurfaceOptions options;
  options.samples = settings.surface_samples;
  options.seed = settings.seed;
  const SurfaceScores scores = surface_scores(shapes.predicted.mesh, shapes.truth.mesh, options);
  result.set("surface_chamfer", scores.chamfer);
  result.set("fscore", scores.fscore_005);
  result.set("fscore_001", scores.fscore_001);
  result.set("normal_consistency", scores.normal_consistency);
  result.details["hausdorff"] = scores.hausdorff;
}

void add_category(const ComparedShapes& shapes, const CategoryQuestion& question, PairResult& result) {
  if (question.references == nullptr)
    return result.skip("category", "no --category-split given, or none of its shapes has a category");
  if (question.expected.empty())
    return result.skip("category", "the ground truth's data set does not say what kind it is");
  const CategoryReferences::Match match = question.references->nearest(shapes.predicted.mesh, question.truth_id);
  result.set("category", match.category == question.expected ? 1.0 : 0.0);
  result.details["category"] = {
      {"expected", question.expected}, {"nearest", match.id}, {"is", match.category}, {"chamfer", match.chamfer}};
}

void add_image_metrics(const ComparedShapes& shapes, const PairSettings& settings, const PerceptualDistance& perceptual,
                       PairResult& result) {
  if (has_colors(shapes.predicted) != has_colors(shapes.truth))
    return skip_group("image", "only one side has colours, so colour renders do not compare", result);
  ViewOptions options;
  options.size = settings.image_size;
  const ImageScores scores = image_scores(render_views(shapes.predicted, Similarity(), options),
                                          render_views(shapes.truth, Similarity(), options), perceptual);
  result.set("psnr", scores.psnr);
  result.set("ssim", scores.ssim);
  if (scores.lpips)
    result.set("lpips", *scores.lpips);
  else
    result.skip("lpips", "no weights given");
}

}  // namespace anigen::eval
