#include "anigen/models/anymate/key_mask.h"

#include <string>

#include "anigen/models/anymate/checks.h"
#include "anigen/nn/blocked_attention.h"

namespace anigen::models::anymate {

KeyMask::KeyMask(const Tensor& mask) {
  require_shape(mask, {-1, -1}, "mask");
  const Tensor counts = mask != 0;
  keys_ = mask.size(1);
  if (counts.all().item<bool>()) return;
  for (const Tensor& item : counts.unbind(0)) {
    const Tensor rows = item.nonzero().flatten();
    rows_.push_back(rows.size(0) == keys_ ? Tensor() : rows);
  }
}

Tensor masked_attention(const Tensor& q, const Tensor& k, const Tensor& v, const KeyMask& mask) {
  if (mask.all()) return nn::blocked_attention(q, k, v);
  require(mask.items() == q.size(0) && mask.keys() == k.size(2), "mask",
          "is for " + std::to_string(mask.items()) + " items of " + std::to_string(mask.keys()) + " keys, not " +
              std::to_string(q.size(0)) + " of " + std::to_string(k.size(2)));
  std::vector<Tensor> items;
  for (std::int64_t b = 0; b < mask.items(); ++b) {
    const Tensor queries = q.narrow(0, b, 1), keys = k.narrow(0, b, 1), values = v.narrow(0, b, 1);
    const Tensor& rows = mask.rows(b);
    if (!rows.defined()) {
      items.push_back(nn::blocked_attention(queries, keys, values));
    } else if (rows.size(0) == 0) {
      items.push_back(values.mean(2, /*keepdim=*/true).expand(queries.sizes()));
    } else {
      items.push_back(nn::blocked_attention(queries, keys.index_select(2, rows), values.index_select(2, rows)));
    }
  }
  return torch::cat(items, 0);
}

}  // namespace anigen::models::anymate
