#include "anigen/sparse/resampling.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <vector>

#include "anigen/core/error.h"
#include "tests/sparse/attention_cases.h"

namespace anigen::sparse {
namespace {

TEST(Resampling, CoarseFeaturesCountTheZeroTheyStartFrom) {
  torch::manual_seed(31);
  const SparseTensor x = cases::random_sparse({60, 0, 40}, 6, 3, torch::kFloat64);
  const SparseTensor coarse = downsample(x, 2);
  const Tensor row = x.support->coarsened(2).row;
  for (std::int64_t c = 0; c < coarse.support->size(); ++c) {
    const Tensor members = x.feats.index_select(0, row.eq(c).nonzero().squeeze(1));
    EXPECT_LT(cases::distance(coarse.feats[c], members.sum(0) / static_cast<double>(members.size(0) + 1)), 1e-12);
  }
  const SparseTensor back = upsample(coarse, x.support, 2);
  EXPECT_EQ(back.support, x.support);
  EXPECT_TRUE(torch::equal(back.feats, coarse.feats.index_select(0, row)));
}

TEST(Resampling, GradientsMatchFiniteDifferences) {
  torch::manual_seed(32);
  const SparseTensor x = cases::random_sparse({30, 20}, 4, 2, torch::kFloat64);
  const Tensor direction = torch::randn_like(subdivide(x).feats), step = torch::randn_like(x.feats);
  const auto loss = [&](const Tensor& feats) {
    const SparseTensor up = upsample(downsample(x.with(feats.sin()), 3), x.support, 3);
    return (subdivide(up).feats * direction).sum();
  };
  const Tensor feats = x.feats.clone().requires_grad_();
  const double found = (torch::autograd::grad({loss(feats)}, {feats})[0] * step).sum().item<double>();
  const double h = 1e-5;  // error of the central difference ~ h² third derivative, of rounding ~ 1e-14 / h
  const double slope = (loss(x.feats + h * step) - loss(x.feats - h * step)).item<double>() / (2 * h);
  EXPECT_NEAR(found, slope, 1e-6 * (1.0 + std::abs(slope)));
}

// One voxel at a time: members of each coarse place in a map, which is sorted as the rows shall be.
TEST(Resampling, AFactorPerAxisAgreesWithOneVoxelAtATime) {
  torch::manual_seed(35);
  const SparseTensor x = cases::random_sparse({70, 0, 45}, 9, 3, torch::kFloat64);
  const std::int64_t rows = x.support->size();
  const Tensor coords = x.support->coords().to(torch::kInt64);
  for (const GridFactor& factor :
       {GridFactor(1, 2, 4), GridFactor(4, 1, 2), GridFactor(1, 1, 3), GridFactor(2, 2, 2)}) {
    std::map<std::vector<std::int64_t>, std::vector<std::int64_t>> members;  // item, x, y, z → fine rows
    for (std::int64_t row = 0; row < rows; ++row) {
      std::vector<std::int64_t> place{coords[row][0].item<std::int64_t>()};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        place.push_back(coords[row][static_cast<std::int64_t>(axis) + 1].item<std::int64_t>() / factor.axes[axis]);
      }
      members[place].push_back(row);
    }
    const Tensor feats = x.feats.clone().requires_grad_();
    const SparseTensor coarse = downsample(x.with(feats), factor), back = upsample(coarse, x.support, factor);
    const Tensor direction = torch::randn_like(coarse.feats), back_direction = torch::randn_like(back.feats);
    const Tensor down_slope = torch::autograd::grad({coarse.feats}, {feats}, {direction}, /*retain_graph=*/true)[0];
    const Tensor up_slope = torch::autograd::grad({back.feats}, {feats}, {back_direction})[0];
    ASSERT_EQ(coarse.support->size(), static_cast<std::int64_t>(members.size()));
    std::int64_t at = 0;
    for (const auto& [place, fine] : members) {
      EXPECT_TRUE(torch::equal(coarse.support->coords()[at].to(torch::kInt64), torch::tensor(place, torch::kInt64)));
      const double share = 1.0 / static_cast<double>(fine.size() + 1);
      Tensor sum = torch::zeros({3}, torch::kFloat64), slopes = torch::zeros({3}, torch::kFloat64);
      for (const std::int64_t row : fine) {
        sum += x.feats[row];
        slopes += back_direction[row];
      }
      EXPECT_LT(cases::distance(coarse.feats[at].detach(), sum * share), 1e-12);
      for (const std::int64_t row : fine) {
        EXPECT_LT(cases::distance(back.feats[row].detach(), sum * share), 1e-12);
        EXPECT_LT(cases::distance(down_slope[row], direction[at] * share), 1e-12);
        EXPECT_LT(cases::distance(up_slope[row], slopes * share), 1e-12);
      }
      ++at;
    }
  }
}

TEST(Resampling, OneFactorStandsForThree) {
  torch::manual_seed(36);
  const SparseTensor x = cases::random_sparse({60, 40}, 7, 3);
  EXPECT_TRUE(torch::equal(downsample(x, 2).feats, downsample(x, {2, 2, 2}).feats));
  EXPECT_FALSE(downsample(x, 2).support->size() == downsample(x, {1, 2, 2}).support->size());
  EXPECT_THROW(downsample(x, {2, 0, 2}), InputError);
  EXPECT_THROW(upsample(downsample(x, {1, 2, 2}), x.support, 2), c10::Error);
}

TEST(Resampling, ChildrenRepeatTheirVoxel) {
  torch::manual_seed(33);
  const SparseTensor x = cases::random_sparse({20}, 4, 5), fine = subdivide(x);
  EXPECT_EQ(fine.support, x.support->subdivided());
  EXPECT_TRUE(torch::equal(fine.feats, x.feats.repeat_interleave(8, 0)));
}

TEST(Resampling, SixteenBitSumsDoNotLoseMembers) {
  // 512 ones: a 16-bit sum would stop growing at 256.
  const Tensor cells = torch::arange(512);
  const Tensor x = torch::floor_divide(cells, 64), y = torch::floor_divide(cells, 8).remainder(8),
               z = cells.remainder(8);
  const SupportPtr support = Support::create(torch::stack({torch::zeros_like(x), x, y, z}, 1));
  const SparseTensor coarse = downsample({support, torch::ones({512, 1}, torch::kBFloat16)}, 8);
  EXPECT_EQ(coarse.feats.scalar_type(), torch::kBFloat16);
  EXPECT_NEAR(coarse.feats.item<double>(), 512.0 / 513.0, 0.004);  // one unit in the last place
}

TEST(Resampling, UpsamplingNeedsTheCoarserVoxels) {
  torch::manual_seed(34);
  const SparseTensor x = cases::random_sparse({40}, 6, 3), other = cases::random_sparse({40}, 6, 3);
  EXPECT_THROW(upsample(downsample(other, 2), x.support, 2), c10::Error);
  // Another support with the same voxels will do.
  const SparseTensor same{Support::create(x.support->coords()), x.feats};
  EXPECT_EQ(upsample(downsample(same, 2), x.support, 2).support, x.support);
}

TEST(Resampling, NoVoxels) {
  const SparseTensor x{Support::create(torch::zeros({0, 4}, torch::kInt32), 1), torch::zeros({0, 3})};
  EXPECT_EQ(downsample(x, 2).feats.sizes(), (std::vector<std::int64_t>{0, 3}));
  EXPECT_EQ(subdivide(x).feats.sizes(), (std::vector<std::int64_t>{0, 3}));
}

}  // namespace
}  // namespace anigen::sparse
