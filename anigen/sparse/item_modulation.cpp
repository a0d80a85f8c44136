#include "anigen/sparse/item_modulation.h"

#include <vector>

#include "anigen/nn/layer_norm.h"

namespace anigen::sparse {
namespace {

// The results of body(item) one below the other. Values of an item spread over its rows by an index would have to be
// stored, and added up again row by row for the gradient; broadcasting inside an item spares both.
template <typename Body>
Tensor for_each_item(const nn::Ragged& items, const Body& body) {
  std::vector<Tensor> parts;
  for (std::int64_t i = 0; i < items.items(); ++i) parts.push_back(body(i));
  return parts.size() == 1 ? parts[0] : torch::cat(parts, 0);
}

}  // namespace

ItemModulation::ItemModulation(SupportPtr support, Tensor shift, const Tensor& scale, Tensor gate)
    : support_(std::move(support)), shift_(std::move(shift)), factor_(scale + 1.0), gate_(std::move(gate)) {}

Tensor ItemModulation::modulate(const Tensor& x) const {
  const Tensor normed = nn::layer_norm(x);
  const nn::Ragged& items = support_->items();
  if (items.items() == 0) return normed;
  const std::vector<Tensor> rows = items.split(normed);
  return for_each_item(items, [&](std::int64_t i) {
    return torch::addcmul(shift_.narrow(0, i, 1), rows[static_cast<std::size_t>(i)], factor_.narrow(0, i, 1));
  });
}

Tensor ItemModulation::add_gated(const Tensor& x, const Tensor& result) const {
  const nn::Ragged& items = support_->items();
  if (items.items() == 0) return x;
  const std::vector<Tensor> starts = items.split(x), rows = items.split(result);
  return for_each_item(items, [&](std::int64_t i) {
    const auto at = static_cast<std::size_t>(i);
    return torch::addcmul(starts[at], rows[at], gate_.narrow(0, i, 1));
  });
}

std::pair<ItemModulation, ItemModulation> item_modulations(nn::Modulation& layer, const Tensor& mod,
                                                           const SparseTensor& x) {
  const Tensor rows = layer.is_empty() ? mod : layer->forward(mod);
  TORCH_CHECK(rows.dim() == 2 && rows.size(1) == 6 * x.channels() && rows.size(0) == x.support->items().items(),
              "modulation ", rows.sizes(), " of a block with ", x.channels(), " channels and ",
              x.support->items().items(), " items");
  const std::vector<Tensor> parts = rows.chunk(6, -1);
  return {ItemModulation(x.support, parts[0], parts[1], parts[2]),
          ItemModulation(x.support, parts[3], parts[4], parts[5])};
}

nn::Linear linear_layer_of(const nn::Modulation& modulation) {
  if (modulation.is_empty()) return nullptr;
  return modulation->linear;
}

}  // namespace anigen::sparse
