#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/train/generator_state.h"
#include "anigen/train/trainer.h"

// One step of the loop in trainer.cpp.
namespace anigen::train {
namespace {

using Clock = std::chrono::steady_clock;

double so_far(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

std::string joined_ids(const loaders::Batch& batch) {
  std::string line;
  for (const std::string& id : batch.ids) line += (line.empty() ? "" : ", ") + id;
  return line;
}

// Works on the trainer's micro-batches, whose type is its own.
template <typename MicroBatches>
bool finite_losses(const MicroBatches& done) {
  for (const auto& each : done) {
    for (const auto& entry : each.logged) {
      if (!std::isfinite(entry.second)) return false;
    }
  }
  return true;
}

}  // namespace

void Trainer::train_micro_batches(const loaders::StepBatches& batches, const std::vector<std::size_t>& ours,
                                  std::vector<MicroBatch>& done) {
  const double scale = update_->loss_scale() / static_cast<double>(batches.size());
  workers_->run([&](std::size_t replica) {
    for (std::size_t k = replica; k < ours.size(); k += workers_->count()) {
      const std::size_t i = ours[k];
      Values& logged = done[k].logged;
      log::debug("step {}, micro-batch {}: {}", step_, i, joined_ids(*batches[i]));
      const Clock::time_point begin = Clock::now();
      const Losses losses = [&] {
        RECORD_USER_SCOPE("step: forward, the rest");
        return stages_[replica]->losses(*batches[i], {options_.seed, step_, i});
      }();
      logged.emplace_back("loss.total", losses.total.item<double>());
      for (const auto& [name, term] : losses.terms) logged.emplace_back("loss." + name, term.item<double>());
      for (const auto& [name, value] : logged) {
        if (std::isfinite(value) || options_.update.loss_scaling || !done[k].problem.empty()) continue;
        done[k].problem = "step " + std::to_string(step_) + ": " + name + " is " + std::to_string(value) +
                          " for samples " + joined_ids(*batches[i]) +
                          "; nothing was updated, the last checkpoint is sound";
        // Other ranks wait for this one's gradients, whatever they are worth.
        if (alone()) throw Error(done[k].problem);
      }
      const Clock::time_point middle = Clock::now();
      if (buckets_ && workers_->count() == 1 && k + 1 == ours.size()) buckets_->expect_last_backward();
      {
        RECORD_USER_SCOPE("step: backward, the rest");
        (losses.total * scale).backward();
      }
      if (replica != 0) continue;
      times_.forward += std::chrono::duration<double>(middle - begin).count();
      times_.backward += so_far(middle);
    }
  });
}

StepVerdict Trainer::sum_gradients(const StepReport& report) {
  if (alone()) {
    for (ParameterBuffer& buffer : buffers_) buffer.collect_gradients();
    torch::Tensor gradient = buffers_.front().gradient();
    for (std::size_t i = 1; i < buffers_.size(); ++i) gradient.add_(buffers_[i].gradient());
    StepVerdict verdict{report.loss_sum, {}, report.interrupted, report.out_of_time};
    if (report.bad_loss) verdict.bad_loss.push_back(0);
    return verdict;
  }
  RECORD_USER_SCOPE("step: waiting for other ranks");
  buckets_->start_rest(buffers_);
  StepAgreement agreement(*ranks_, report);
  times_.communication += buckets_->finish();
  return agreement.finish();
}

StepVerdict Trainer::train_step(const loaders::StepBatches& batches) {
  if (!alone()) generator_then_ = generator_state();
  for (ParameterBuffer& buffer : buffers_) buffer.zero_gradients();
  std::vector<std::size_t> ours;
  for (std::size_t i = 0; i < batches.size(); ++i) {
    if (batches[i]) ours.push_back(i);
  }
  std::vector<MicroBatch> done(ours.size());
  train_micro_batches(batches, ours, done);

  const Clock::time_point begin = Clock::now();
  RECORD_USER_SCOPE("step: update of the weights");
  StepReport report;
  for (const MicroBatch& each : done) report.loss_sum += each.logged.front().second;
  report.bad_loss = !finite_losses(done);
  report.interrupted = interrupt_requested();
  report.out_of_time = out_of_time();
  const double waited_before = times_.communication;
  const StepVerdict verdict = sum_gradients(report);
  if (!verdict.bad_loss.empty() && !options_.update.loss_scaling) stop_at_losses(done);
  torch::Tensor gradient = buffers_.front().gradient();
  // Under loss scaling such a step is skipped, also where the loss overflows and its gradient does not.
  if (!verdict.bad_loss.empty()) gradient.fill_(std::numeric_limits<double>::quiet_NaN());
  const ParameterUpdate::Result result = update_->apply(step_);
  if (result.skipped && !options_.update.loss_scaling) stop_at_gradient(batches);
  if (result.restored) {
    log::warn("step {}: the update left weights that are not finite; training goes on with those of step {}", step_,
              update_->recovery.step());
  }
  for (std::size_t i = 1; i < buffers_.size(); ++i) buffers_[i].publish();
  times_.update += so_far(begin) - (times_.communication - waited_before);
  ++timed_steps_;
  samples_ += options_.batch_size;
  last_loss_ = verdict.loss_sum / static_cast<double>(batches.size());
  for (const MicroBatch& each : done) {
    for (const auto& [name, value] : each.logged) means_.add(name, value);
  }
  if (!first()) return verdict;  // the rest is the same everywhere
  means_.add("status.grad_norm", result.grad_norm);
  means_.add("status.lr", result.lr);
  if (update_->clipper) means_.add("status.clip_at", update_->clipper->threshold());
  if (options_.update.loss_scaling) means_.add("status.log_scale", update_->log_scale);
  return verdict;
}

void Trainer::stop_at_losses(const std::vector<MicroBatch>& done) {
  std::string own;
  for (const MicroBatch& each : done) {
    if (own.empty()) own = each.problem;
  }
  const std::vector<std::string> problems = ranks_->gather(own);
  std::string line;
  for (std::size_t rank = 0; rank < problems.size(); ++rank) {
    if (!problems[rank].empty())
      line += (line.empty() ? "rank " : "; rank ") + std::to_string(rank) + ", " + problems[rank];
  }
  throw Error(line);
}

void Trainer::stop_at_gradient(const loaders::StepBatches& batches) {
  std::string own;
  if (alone() || !buckets_->own_gradients_finite()) {
    for (const auto& batch : batches) {
      if (batch) own += (own.empty() ? "" : ", ") + joined_ids(*batch);
    }
  }
  const std::vector<std::string> samples = ranks_->gather(own);
  std::string where;
  for (std::size_t rank = 0; rank < samples.size(); ++rank) {
    if (samples[rank].empty()) continue;
    where += (where.empty() ? "" : ";") + (alone() ? std::string() : " on rank " + std::to_string(rank)) +
             " for samples " + samples[rank];
  }
  if (where.empty()) where = " in its sum over all ranks";
  throw Error("step " + std::to_string(step_) + ": the gradient of " +
              buffers_.front().first_not_finite(buffers_.front().gradient()) + " is not finite" + where +
              "; nothing was updated, the last checkpoint is sound");
}

}  // namespace anigen::train
