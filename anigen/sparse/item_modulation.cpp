#include "anigen/sparse/item_modulation.h"

#include <vector>

#include "anigen/nn/layer_norm.h"
#include "anigen/nn/modulated_rows.h"

namespace anigen::sparse {

ItemModulation::ItemModulation(SupportPtr support, Tensor shift, Tensor scale, Tensor gate)
    : support_(std::move(support)), shift_(std::move(shift)), scale_(std::move(scale)), gate_(std::move(gate)) {}

Tensor ItemModulation::modulate(const Tensor& x) const {
  return nn::modulated_norm(x, support_->items(), shift_, scale_, nn::kBlockNormEps);
}

Tensor ItemModulation::add_gated(const Tensor& x, const Tensor& result) const {
  return nn::add_gated(x, support_->items(), gate_, result);
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
