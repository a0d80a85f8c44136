#include "anigen/sparse/resampling.h"

namespace anigen::sparse {

SparseTensor downsample(const SparseTensor& x, const GridFactor& factor) {
  const Coarsening& coarse = x.support->coarsened(factor);
  const torch::Dtype dtype = nn::dtype_of(x.feats), wide = nn::accumulation_dtype(dtype);
  const torch::Device device = x.feats.device();
  const Tensor sums = torch::zeros({coarse.support->size(), x.channels()}, x.feats.options().dtype(wide))
                          .index_add(0, coarse.row.to(device), x.feats.to(wide));
  const Tensor members = coarse.count.to(device).to(wide).unsqueeze(1);
  return {coarse.support, (sums / (members + 1)).to(dtype)};
}

SparseTensor upsample(const SparseTensor& coarse, const SupportPtr& fine, const GridFactor& factor) {
  const Coarsening& coarsening = fine->coarsened(factor);
  TORCH_CHECK(
      coarse.support == coarsening.support || torch::equal(coarse.support->coords(), coarsening.support->coords()),
      "up-sampling from ", coarse.support->size(), " voxels, which are not the ", coarsening.support->size(),
      " that the ", fine->size(), " fine ones lie in");
  return {fine, coarse.feats.index_select(0, coarsening.row.to(coarse.feats.device()))};
}

SparseTensor subdivide(const SparseTensor& x) {
  const std::int64_t rows = x.support->size();
  return {x.support->subdivided(),
          x.feats.unsqueeze(1).expand({rows, 8, x.channels()}).reshape({8 * rows, x.channels()})};
}

}  // namespace anigen::sparse
