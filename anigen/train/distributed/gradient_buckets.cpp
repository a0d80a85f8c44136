#include "anigen/train/distributed/gradient_buckets.h"

#include <torch/csrc/autograd/function.h>
#include <torch/csrc/autograd/utils/lambda_post_hook.h>
#include <torch/csrc/autograd/variable.h>
#include <algorithm>
#include <chrono>
#include <cstring>
#include <map>

#include "anigen/core/error.h"

namespace anigen::train {

namespace {

enum Place { kLoss, kAnyInterrupted, kOutOfTime, kBadLoss };  // in values_; from kBadLoss on one per rank

constexpr std::size_t kLanes = 4;  // independent chains of multiplications
constexpr std::uint64_t kPrime = 0x100000001b3ULL, kStart = 0xcbf29ce484222325ULL;  // of FNV-1a

std::uint64_t mixed(std::uint64_t hash, std::uint64_t word) {
  hash = (hash ^ word) * kPrime;
  return hash ^ (hash >> 29);
}

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

StepAgreement::StepAgreement(Communicator& ranks, const StepReport& report)
    : values_(torch::zeros({kBadLoss + ranks.size()}, torch::kFloat64)) {
  double* values = values_.data_ptr<double>();
  values[kLoss] = report.loss_sum;
  values[kAnyInterrupted] = report.interrupted ? 1.0 : 0.0;
  values[kOutOfTime] = report.out_of_time && ranks.rank() == 0 ? 1.0 : 0.0;
  values[kBadLoss + ranks.rank()] = report.bad_loss ? 1.0 : 0.0;
  sum_ = ranks.start_sum(values_);
}

StepVerdict StepAgreement::finish() {
  sum_->wait();
  const double* values = values_.data_ptr<double>();
  StepVerdict verdict;
  verdict.loss_sum = values[kLoss];
  verdict.interrupted = values[kAnyInterrupted] > 0.0;
  verdict.out_of_time = values[kOutOfTime] > 0.0;
  for (int rank = 0; rank < values_.size(0) - kBadLoss; ++rank) {
    if (values[kBadLoss + rank] > 0.0) verdict.bad_loss.push_back(rank);
  }
  return verdict;
}

std::uint64_t checksum(const torch::Tensor& flat) {
  const torch::Tensor values = flat.detach().to(torch::kCPU).contiguous();
  const char* bytes = static_cast<const char*>(values.data_ptr());
  const std::size_t size = static_cast<std::size_t>(values.nbytes()), word = sizeof(std::uint64_t);
  std::uint64_t lanes[kLanes];
  for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] = kStart + lane;
  const auto read = [&](std::size_t at) {
    std::uint64_t value = 0;
    std::memcpy(&value, bytes + at, std::min(word, size - at));
    return value;
  };
  std::size_t at = 0;
  for (; at + kLanes * word <= size; at += kLanes * word) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] = mixed(lanes[lane], read(at + lane * word));
  }
  for (; at < size; at += word) lanes[0] = mixed(lanes[0], read(at));
  std::uint64_t hash = kStart ^ size;
  for (const std::uint64_t lane : lanes) hash = mixed(hash, lane);
  return hash;
}

void require_same_parameters(Communicator& ranks, const torch::Tensor& flat, const std::string& moment) {
  if (ranks.size() == 1) return;
  const std::vector<std::string> sums = ranks.gather(std::to_string(checksum(flat)));
  std::map<std::string, int> votes;
  for (const std::string& sum : sums) ++votes[sum];
  if (votes.size() == 1) return;
  std::string usual = sums.front();  // of as many as any other: rank 0's
  for (const auto& [sum, count] : votes) {
    if (count > votes[usual]) usual = sum;
  }
  std::string different;
  for (std::size_t rank = 0; rank < sums.size(); ++rank) {
    if (sums[rank] != usual) different += (different.empty() ? "" : ", ") + std::to_string(rank);
  }
  throw Error(moment + ": parameters are no longer the same on all ranks; those of rank " + different +
              " differ from the others'. Nothing was saved since; start again from the last checkpoint");
}

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
  while (options_.overlap && next_ < plan_.size() && plan_[next_].missing == 0) start(plan_[next_], nullptr);
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
