#include "anigen/train/distributed/gradient_buckets.h"

#include <torch/csrc/autograd/function.h>
#include <torch/csrc/autograd/utils/lambda_post_hook.h>
#include <torch/csrc/autograd/variable.h>

#include <algorithm>
#include <chrono>
#include <cstring>

#include "anigen/core/error.h"

namespace anigen::train {
namespace {

using torch::autograd::variable_list;

constexpr std::size_t kNone = static_cast<std::size_t>(-1);

std::string bytes_of(const std::vector<std::size_t>& order) {
  std::string bytes(order.size() * sizeof(std::size_t), '\0');
  if (!order.empty()) std::memcpy(bytes.data(), order.data(), bytes.size());
  return bytes;
}

std::vector<std::size_t> order_of(const std::string& bytes) {
  std::vector<std::size_t> order(bytes.size() / sizeof(std::size_t));
  if (!order.empty()) std::memcpy(order.data(), bytes.data(), order.size() * sizeof(std::size_t));
  return order;
}

}  // namespace

GradientBuckets::GradientBuckets(ParameterBuffer& buffer, Communicator& ranks, const Options& options)
    : buffer_(buffer), ranks_(ranks), options_(options), late_(kNone) {
  const auto& slots = buffer.slots();
  ready_.assign(slots.size(), false);
  in_parts_.assign(slots.size(), false);
  bucket_of_.assign(slots.size(), kNone);
  for (std::size_t i = 0; i < slots.size(); ++i) {
    accumulators_.push_back(torch::autograd::impl::grad_accumulator(slots[i].parameter));
    hooks_.push_back(accumulators_.back()->add_post_hook(std::make_unique<torch::autograd::utils::LambdaPostHook>(
        [this, i](const variable_list& outputs, const variable_list&) {
          if (listening_) ready(i);
          return outputs;
        })));
  }
}

GradientBuckets::~GradientBuckets() {
  for (std::size_t i = 0; i < hooks_.size(); ++i) accumulators_[i]->del_post_hook(hooks_[i]);
}

void GradientBuckets::expect_last_backward() { listening_ = true; }

void GradientBuckets::ready(std::size_t slot) {
  if (ready_[slot]) {
    in_parts_[slot] = true;
    if (!plan_.empty() && bucket_of_[slot] < next_) late_ = slot;
    return;
  }
  if (in_parts_[slot]) return;
  ready_[slot] = true;
  if (plan_.empty()) {
    order_.push_back(slot);
    return;
  }
  --plan_[bucket_of_[slot]].missing;
  while (options_.overlap && next_ < plan_.size() && plan_[next_].missing == 0) {
    start(plan_[next_], nullptr);
  }
}

void GradientBuckets::agree_on_plan() {
  const auto last = std::remove_if(order_.begin(), order_.end(), [this](std::size_t slot) { return in_parts_[slot]; });
  order_.erase(last, order_.end());
  std::vector<std::size_t> order = order_of(ranks_.gather(ranks_.rank() == 0 ? bytes_of(order_) : "").front());
  std::vector<bool> listed(ready_.size(), false);
  for (const std::size_t slot : order) listed.at(slot) = true;
  for (std::size_t slot = ready_.size(); slot-- > 0;) {
    if (!listed[slot]) order.push_back(slot);
  }
  const std::int64_t each = buffer_.gradient().element_size();
  std::vector<std::size_t> slots;
  std::int64_t bytes = 0;
  for (const std::size_t slot : order) {
    slots.push_back(slot);
    bytes += buffer_.slots()[slot].parameter.numel() * each;
    if (bytes < (plan_.empty() ? options_.first_bytes : options_.bytes)) continue;
    add_bucket(slots);
    slots.clear();
    bytes = 0;
  }
  if (!slots.empty()) add_bucket(slots);
  order_.clear();
}

void GradientBuckets::add_bucket(const std::vector<std::size_t>& given) {
  Bucket bucket;
  bucket.slots = given;
  std::sort(bucket.slots.begin(), bucket.slots.end());
  const auto& slots = buffer_.slots();
  const std::int64_t first = slots[bucket.slots.front()].offset;
  std::int64_t count = 0;
  for (const std::size_t slot : bucket.slots) {
    count += slots[slot].parameter.numel();
    bucket_of_[slot] = plan_.size();
  }
  const auto& last = slots[bucket.slots.back()];
  bucket.in_place = last.offset + last.parameter.numel() - first == count;
  bucket.flat = bucket.in_place ? buffer_.gradient().narrow(0, first, count)
                                : torch::empty({count}, buffer_.gradient().options());
  plan_.push_back(std::move(bucket));
}

void GradientBuckets::start(Bucket& bucket, const std::vector<ParameterBuffer>* buffers) {
  const torch::NoGradGuard no_grad;
  std::int64_t offset = 0;
  for (const std::size_t slot : bucket.slots) {
    const ParameterBuffer::Slot& each = buffer_.slots()[slot];
    const torch::Tensor part = buffer_.part(buffer_.gradient(), each);
    buffer_.collect_gradient(each);
    for (std::size_t copy = 1; buffers != nullptr && copy < buffers->size(); ++copy) {
      const ParameterBuffer& other = (*buffers)[copy];
      other.collect_gradient(other.slots()[slot]);
      torch::Tensor(part).add_(other.part(other.gradient(), each));
    }
    if (bucket.in_place) continue;
    bucket.flat.narrow(0, offset, part.numel()).copy_(part.reshape({-1}));
    offset += part.numel();
  }
  if (next_ == 0) own_sums_.clear();
  own_sums_.push_back(bucket.flat.sum());
  ++next_;
  bucket.sum = ranks_.start_sum(bucket.flat);
}

void GradientBuckets::start_rest(const std::vector<ParameterBuffer>& buffers) {
  listening_ = false;
  if (late_ != kNone) {
    throw Error("the gradient of " + buffer_.slots()[late_].name +
                " came in parts, the last after the first was on its way to the other ranks, which did not happen in "
                "the first step: a part of the model that is computed again in the backward pass shares it");
  }
  if (plan_.empty()) agree_on_plan();
  while (next_ < plan_.size()) start(plan_[next_], &buffers);
}

double GradientBuckets::finish() {
  const torch::NoGradGuard no_grad;
  const auto begin = std::chrono::steady_clock::now();
  for (Bucket& bucket : plan_) {
    bucket.sum->wait();
    bucket.sum.reset();
  }
  const double waited = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  for (Bucket& bucket : plan_) {
    bucket.missing = bucket.slots.size();
    if (bucket.in_place) continue;
    std::int64_t offset = 0;
    for (const std::size_t slot : bucket.slots) {
      const ParameterBuffer::Slot& each = buffer_.slots()[slot];
      const std::int64_t count = each.parameter.numel();
      buffer_.gradient().narrow(0, each.offset, count).copy_(bucket.flat.narrow(0, offset, count));
      offset += count;
    }
  }
  std::fill(ready_.begin(), ready_.end(), false);
  next_ = 0;
  return waited;
}

bool GradientBuckets::own_gradients_finite() const {
  for (const torch::Tensor& sum : own_sums_) {
    if (!torch::isfinite(sum).item<bool>()) return false;
  }
  return true;
}

}  // namespace anigen::train
