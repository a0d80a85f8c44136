// Sparse tensors without attention: convolution, resampling, group norm, batches.
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/norms.h"
#include "anigen/sparse/blocks.h"
#include "anigen/sparse/convolution.h"
#include "anigen/sparse/norms.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

SparseTensor operator_input(const Fixture& fixture, const std::string& coords, const std::string& feats) {
  return {sparse::Support::create(fixture.input(coords)), fixture.input(feats)};
}

// [B, 2]: first row of each item and the row behind its last.
Tensor layout_of(const sparse::Support& support) {
  std::vector<std::int64_t> rows;
  const nn::Ragged& items = support.items();
  for (std::int64_t item = 0; item < items.items(); ++item) {
    rows.push_back(items.offset(item));
    rows.push_back(items.offset(item) + items.lengths()[static_cast<std::size_t>(item)]);
  }
  return torch::tensor(rows, torch::TensorOptions().dtype(torch::kInt64)).view({items.items(), 2});
}

// A convolution with the sizes of the weight that the fixture stores for it.
sparse::SubmanifoldConv3d stored_convolution(const Fixture& fixture, const std::string& part) {
  const io::NamedArrays parameters = parameters_of(fixture, part);
  const io::NdArray* weight = io::find(parameters, "conv.weight");
  if (weight == nullptr) throw Error(fixture.name() + " has no weight of " + part);
  const auto size = [&](std::size_t axis) { return static_cast<std::int64_t>(weight->shape.at(axis)); };
  sparse::SubmanifoldConv3d convolution(size(4), size(0), size(1));
  load_part(convolution, fixture, part);
  return convolution;
}

void run_sparse_primitives(Fixture& fixture) {
  constexpr std::int64_t kFactor = 2;  // the fixture says so in words
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  const SparseTensor x = operator_input(fixture, "coords", "feats");
  fixture.check_true("a kernel of three voxels", config.at("kernel") == 3);
  fixture.check("conv3", stored_convolution(fixture, "conv3")->forward(x).feats);
  fixture.check("conv1_rect", stored_convolution(fixture, "conv1_rect")->forward(x).feats);
  fixture.check("conv1_square",
                stored_convolution(fixture, "conv1_square")->forward(x.with(fixture.input("feats_out"))).feats);

  const SparseTensor down = sparse::downsample(x, kFactor), up = sparse::upsample(down, x.support, kFactor);
  fixture.check("down_coords", down.support->coords());
  fixture.check("down_feats", down.feats);
  fixture.check("up_coords", up.support->coords());
  fixture.check("up_feats", up.feats);
  const SparseTensor fine = sparse::subdivide(x);
  fixture.check("sub_coords", fine.support->coords());
  fixture.check("sub_feats", fine.feats);

  sparse::SparseGroupNorm norm(x.channels(), config.at("groups").get<std::int64_t>());
  load_part(norm, fixture, "gn");
  fixture.check("gn", norm->forward(x).feats);
  fixture.check("ln_nonaffine", nn::layer_norm(x.feats));
}

void run_sparse_conv3d(Fixture& fixture) {
  SparseTensor x = operator_input(fixture, "coords", "feats");
  x.feats.requires_grad_();
  sparse::SubmanifoldConv3d convolution = stored_convolution(fixture, "k3");
  const Tensor y = convolution->forward(x).feats;
  fixture.check("k3", y);
  const std::vector<Tensor> gradients =
      torch::autograd::grad({y}, {x.feats, convolution->conv->weight}, {fixture.input("grad")});
  fixture.check("grad_feats", gradients[0]);
  fixture.check("grad_weight", gradients[1]);

  const torch::NoGradGuard no_grad;
  sparse::SubmanifoldConv3d pointwise = stored_convolution(fixture, "k1");
  fixture.check("k1", pointwise->forward(x).feats);
  const Tensor& weight = pointwise->conv->weight;
  fixture.check("k1_if_transposed",
                torch::linear(x.feats, weight.view({weight.size(0), weight.size(4)}), pointwise->conv->bias));
}

// One number, or one per axis.
sparse::GridFactor grid_factor(const Json& factor) {
  if (factor.is_number()) return factor.get<std::int64_t>();
  return {factor.at(0).get<std::int64_t>(), factor.at(1).get<std::int64_t>(), factor.at(2).get<std::int64_t>()};
}

void run_sparse_down_up(Fixture& fixture) {
  const sparse::GridFactor factor = grid_factor(fixture.config().at("factor"));
  SparseTensor x = operator_input(fixture, "coords", "feats");
  x.feats.requires_grad_();
  const SparseTensor down = sparse::downsample(x, factor), up = sparse::upsample(down, x.support, factor);
  const sparse::Coarsening& coarsening = x.support->coarsened(factor);
  fixture.check("down_coords", down.support->coords());
  fixture.check("down_feats", down.feats);
  fixture.check("idx", coarsening.row.host());
  fixture.check("count", coarsening.count.host());
  fixture.check("up_coords", up.support->coords());
  fixture.check("up_feats", up.feats);
  const Tensor members = coarsening.count.on(fixture.device()).unsqueeze(1).to(torch::kFloat32);
  fixture.check("mean_over_members", down.feats * (members + 1) / members);
  const auto gradient = [&](const Tensor& y, const char* direction) {
    return torch::autograd::grad({y}, {x.feats}, {fixture.input(direction)}, /*retain_graph=*/true)[0];
  };
  fixture.check("grad_feats_down", gradient(down.feats, "grad_down"));
  fixture.check("grad_feats_up", gradient(up.feats, "grad_up"));
}

void run_sparse_group_norm(Fixture& fixture) {
  const Json& config = fixture.config();
  SparseTensor x = operator_input(fixture, "coords", "feats");
  x.feats.requires_grad_();
  sparse::SparseGroupNorm norm(config.at("num_channels").get<std::int64_t>(),
                               config.at("num_groups").get<std::int64_t>(), config.at("eps").get<double>());
  load_whole(norm, fixture);
  const Tensor y = norm->forward(x).feats;
  fixture.check("feats", y);
  const std::vector<Tensor> gradients =
      torch::autograd::grad({y}, {x.feats, norm->weight, norm->bias}, {fixture.input("grad")});
  fixture.check("grad_feats", gradients[0]);
  fixture.check("grad_weight", gradients[1]);
  fixture.check("grad_bias", gradients[2]);
}

// The published tensor class does these by itself; ours are a support and rows, and the operations those of rows.
void run_sparse_layout(Fixture& fixture) {
  const SparseTensor x = operator_input(fixture, "coords", "feats"), x2 = operator_input(fixture, "coords2", "feats2");
  const nn::Ragged& items = x.support->items();
  fixture.check("layout", layout_of(*x.support));
  fixture.check("shape", torch::tensor(std::vector<std::int64_t>{items.items(), x.channels()},
                                       torch::TensorOptions().dtype(torch::kInt64)));
  const Tensor item = x.support->coords().select(1, 0).to(torch::kInt64);
  fixture.check("modulated", x.feats * (1 + fixture.input("scale").index_select(0, item)) +
                                 fixture.input("shift").index_select(0, item));
  fixture.check("plus_per_voxel", x.feats + fixture.input("per_voxel"));
  fixture.check("rsub", 1.5 - x.feats);
  fixture.check("rdiv", (x.feats + 4.0).reciprocal() * 2.0);
  fixture.check("cat1_feats", torch::cat({x.feats, x.feats}, 1));
  const std::int64_t parts = fixture.config().at("unbind");
  fixture.check("unbind1", x.feats.view({x.feats.size(0), parts, x.channels() / parts}).transpose(0, 1));

  const std::vector<Tensor> coords = items.split(x.support->coords()), feats = items.split(x.feats);
  std::vector<Tensor> places, rows;
  for (const std::size_t chosen : {2, 0}) {  // the fixture says so in words
    Tensor renumbered = coords.at(chosen).clone();
    renumbered.select(1, 0).fill_(static_cast<std::int64_t>(places.size()));
    places.push_back(renumbered);
    rows.push_back(feats.at(chosen));
  }
  fixture.check("select_coords", sparse::Support::create(torch::cat(places, 0))->coords());
  fixture.check("select_feats", torch::cat(rows, 0));

  Tensor behind = x2.support->coords().clone();
  behind.select(1, 0).add_(items.items());
  fixture.check("cat0_coords", sparse::Support::create(torch::cat({x.support->coords(), behind}, 0))->coords());
  fixture.check("cat0_feats", torch::cat({x.feats, x2.feats}, 0));
}

void run_sparse_subdivide(Fixture& fixture) {
  const SparseTensor fine = sparse::subdivide(operator_input(fixture, "coords", "feats"));
  fixture.check("coords", fine.support->coords());
  fixture.check("feats", fine.feats);
  fixture.check("layout", layout_of(*fine.support));
}

// Not reachable in the published models: it normalises along the voxels, and fits items of one length only.
void run_sparse_layer_norm(Fixture& fixture) {
  throw NotSupportedError(fixture.name() + ".json", "/config", "a layer norm along the voxels of an item");
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_sparse, anigen::test::run_sparse_primitives)
ANIGEN_DEVICE_PARITY(ops_sparse_conv3d, anigen::test::run_sparse_conv3d)
ANIGEN_DEVICE_PARITY(ops_sparse_down_up, anigen::test::run_sparse_down_up)
ANIGEN_DEVICE_PARITY(ops_sparse_groupnorm, anigen::test::run_sparse_group_norm)
ANIGEN_PARITY(ops_sparse_layout, anigen::test::run_sparse_layout)
ANIGEN_DEVICE_PARITY(ops_sparse_subdivide, anigen::test::run_sparse_subdivide)
ANIGEN_PARITY(ops_sparse_layernorm_quirk, anigen::test::run_sparse_layer_norm)
