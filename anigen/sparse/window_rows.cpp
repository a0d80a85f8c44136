#include "anigen/sparse/window_rows.h"

#include <limits>
#include <vector>

namespace anigen::sparse {
namespace {

class PermuteRows : public torch::autograd::Function<PermuteRows> {
 public:
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& rows, const Tensor& order,
                        const Tensor& inverse) {
    context->save_for_backward({inverse});
    return rows.index_select(0, order);
  }
  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    return {gradients[0].index_select(0, context->get_saved_variables()[0]), Tensor(), Tensor()};
  }
};

Tensor permute_rows(const Tensor& rows, const Tensor& order, const Tensor& inverse) {
  return PermuteRows::apply(rows, order.to(rows.device()), inverse.to(rows.device()));
}

Tensor offset_tensor(const std::vector<std::int64_t>& offsets) {
  return torch::tensor(offsets, torch::TensorOptions().dtype(torch::kInt64));
}

// Windows one after another, by ascending number.
class WindowCursor {
 public:
  explicit WindowCursor(const WindowOrder& windows)
      : numbers_(windows.windows.data_ptr<std::int64_t>()),
        offsets_(windows.offsets.data_ptr<std::int64_t>()),
        count_(windows.windows.size(0)) {
    for (std::int64_t w = 1; w < count_; ++w) {
      TORCH_CHECK(numbers_[w - 1] < numbers_[w], "windows must be in the order of their numbers");
    }
  }
  std::int64_t number() const { return at_ < count_ ? numbers_[at_] : std::numeric_limits<std::int64_t>::max(); }
  bool done() const { return at_ == count_; }
  // Steps over this window if it has that number. @return the row behind it
  std::int64_t end_of(std::int64_t number) {
    if (!done() && numbers_[at_] == number) ++at_;
    return offsets_[at_];
  }

 private:
  const std::int64_t *numbers_, *offsets_;
  std::int64_t count_, at_ = 0;
};

}  // namespace

Tensor to_window_order(const Tensor& rows, const WindowOrder& windows) {
  return permute_rows(rows, windows.order, windows.place);
}

Tensor from_window_order(const Tensor& rows, const WindowOrder& windows) {
  return permute_rows(rows, windows.place, windows.order);
}

PairedOffsets pair_windows(const WindowOrder& queries, const WindowOrder& keys) {
  WindowCursor query(queries), key(keys);
  std::vector<std::int64_t> q_offsets{0}, k_offsets{0};
  while (!query.done() || !key.done()) {
    const std::int64_t number = query.number() < key.number() ? query.number() : key.number();
    q_offsets.push_back(query.end_of(number));
    k_offsets.push_back(key.end_of(number));
  }
  return {offset_tensor(q_offsets), offset_tensor(k_offsets)};
}

}  // namespace anigen::sparse
