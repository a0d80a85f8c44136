#include "anigen/nn/attention_windows.h"

#include <algorithm>
#include <deque>
#include <tuple>
#include <utility>

namespace anigen::nn {

namespace {

thread_local std::int64_t innermost_size = 0;

TokenOrder make_token_order(const GridWindows& windows) {
  const std::int64_t side = windows.side, size = windows.size, shift = windows.shift;
  TORCH_CHECK(side > 0 && size > 0 && shift >= 0 && shift < size, "windows of ", size, " places shifted by ", shift,
              " in a grid of ", side);
  const std::int64_t along = (side - 1 + shift) / size + 1, count = along * along * along;
  const Tensor axis = (torch::arange(side, torch::kInt64) + shift).div(size, "floor");
  const Tensor window =
      ((axis.view({-1, 1, 1}) * along + axis.view({-1, 1})) * along + axis).flatten();  // x slowest, as the tokens
  const Tensor order = std::get<1>(window.sort(/*stable=*/true, /*dim=*/0, /*descending=*/false));
  const Tensor ends = window.bincount({}, count).cumsum(0);
  return {HostTensor(order), HostTensor(order.argsort()), torch::cat({torch::zeros({1}, torch::kInt64), ends})};
}

}  // namespace

AttentionWindows::AttentionWindows(std::int64_t size) : outer_(innermost_size) {
  TORCH_CHECK(size >= 0, "windows of ", size, " places");
  innermost_size = size;
}

AttentionWindows::~AttentionWindows() { innermost_size = outer_; }

std::int64_t AttentionWindows::size() { return innermost_size; }

TokenOrder token_order(const GridWindows& windows) {
  constexpr std::size_t kKept = 4;  // two shifts of two grids
  using Key = std::tuple<std::int64_t, std::int64_t, std::int64_t>;
  thread_local std::deque<std::pair<Key, TokenOrder>> recent;
  const Key key(windows.side, windows.size, windows.shift);
  const auto found = std::find_if(recent.begin(), recent.end(), [&](const auto& kept) { return kept.first == key; });
  if (found != recent.end()) return found->second;
  recent.emplace_front(key, make_token_order(windows));
  if (recent.size() > kKept) recent.pop_back();
  return recent.front().second;
}

}  // namespace anigen::nn
