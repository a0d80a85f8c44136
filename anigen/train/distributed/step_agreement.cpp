#include "anigen/train/distributed/step_agreement.h"

namespace anigen::train {
namespace {

enum Place { kLoss, kAnyInterrupted, kOutOfTime, kBadLoss };  // in values_; from kBadLoss on one per rank

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

}  // namespace anigen::train
