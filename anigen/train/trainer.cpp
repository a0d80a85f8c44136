#include "anigen/train/trainer.h"

#include <ATen/CPUGeneratorImpl.h>
#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/text.h"
#include "anigen/data/metadata.h"
#include "anigen/io/image.h"
#include "anigen/train/distributed/communicator.h"
#include "anigen/train/metrics_log.h"

namespace anigen::train {

namespace {

constexpr std::int64_t kProfileWarmUp = 2;  // steps before those that a profile measures

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

bool due(std::int64_t step, std::int64_t every) { return every > 0 && step % every == 0; }

// The PNG files of a folder, by name; none when a stage wrote no samples.
std::vector<std::filesystem::path> pictures_in(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (entry->path().extension() == ".png") files.push_back(entry->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// The data of a stage, which may get others while these are still read. A stage that is its own source outlives its
/// readers.
std::shared_ptr<const data::BatchSource> held_data(const Stage& stage) {
  const data::BatchSource& data = stage.data();
  std::shared_ptr<const data::BatchSource> held = data.weak_from_this().lock();
  return held ? held : std::shared_ptr<const data::BatchSource>(std::shared_ptr<void>(), &data);
}

data::StepBatches next_batches(data::Prefetcher& batches) {
  RECORD_USER_SCOPE("step: waiting for data");
  return batches.next();
}

// The losses of micro-batches, which are still being computed where the device is a GPU. All are read at once.
class UnreadLosses {
 public:
  void add(const Losses& losses) {
    std::vector<std::string>& names = names_.emplace_back();
    const auto keep = [&](const std::string& name, const torch::Tensor& value) {
      names.push_back("loss." + name);
      values_.push_back(nn::to_device(value.detach(), losses.total.device()).to(torch::kFloat64).reshape({}));
    };
    keep("total", losses.total);
    for (const auto& [name, term] : losses.terms) keep(name, term);
  }

  // Of each micro-batch, in the order of add().
  std::vector<Values> read() const {
    std::vector<Values> all(names_.size());
    if (values_.empty()) return all;
    const torch::Tensor host = torch::stack(values_).to(torch::kCPU);
    std::int64_t next = 0;
    for (std::size_t k = 0; k < all.size(); ++k) {
      for (const std::string& name : names_[k]) all[k].emplace_back(name, host[next++].item<double>());
    }
    return all;
  }

 private:
  std::vector<std::vector<std::string>> names_;
  std::vector<torch::Tensor> values_;  // fp64 scalars
};

// Averaged weights in the models' place for as long as this lives.
class AveragedWeights {
 public:
  AveragedWeights(ParameterBuffer& buffer, const Ema& ema) : buffer_(buffer) {
    if (ema.averages().empty()) return;
    kept_ = buffer.master().clone();
    put(ema.averages().front());
  }
  ~AveragedWeights() {
    if (kept_.defined()) put(kept_);
  }
  AveragedWeights(const AveragedWeights&) = delete;
  AveragedWeights& operator=(const AveragedWeights&) = delete;

 private:
  void put(const torch::Tensor& flat) {
    torch::NoGradGuard no_grad;
    torch::Tensor(buffer_.master()).copy_(flat);
    buffer_.publish();
  }
  ParameterBuffer& buffer_;
  torch::Tensor kept_;
};

}  // namespace

Trainer::Trainer(Stage& stage, const TrainerOptions& options, const RunOptions& run)
    : options_(options),
      run_(run),
      stages_{&stage},
      ranks_(run.ranks ? run.ranks : std::make_shared<SingleProcess>()),
      checkpoints_(RunFolder{run.output}.checkpoints(), options.before_decay),
      started_(Clock::now()) {
  const std::size_t ranks = static_cast<std::size_t>(ranks_->size());
  if (options_.replicas > options_.batch_split)
    throw InputError("", "trainer/args/replicas", "needs a batch_split of at least as many micro-batches");
  if (options_.replicas * ranks > options_.batch_split) {
    throw InputError("", "trainer/args/batch_split",
                     "is " + std::to_string(options_.batch_split) + "; " + std::to_string(ranks) + " ranks of " +
                         std::to_string(options_.replicas) + " replicas need " +
                         std::to_string(options_.replicas * ranks) + " micro-batches, so set it to that or more");
  }
  workers_ =
      std::make_unique<Workers>(options_.replicas, std::max(1, run.threads / static_cast<int>(options_.replicas)));
  check_start(run_);
  check_finetuned_models();
  start_ = agreed_on(first() ? choose_start() : StartPoint());
  const CheckpointFolder source = start_.own ? checkpoints_ : CheckpointFolder(checkpoint_files_of(run_.load));
  const std::optional<std::int64_t> resumed = start_.step;
  if (!resumed) start_from_files();
  const auto convert = [this](Stage& converted) {
    if (options_.compute_dtype != torch::kFloat32) converted.set_compute_dtype(options_.compute_dtype);
  };
  // Masters of a reduced type are full; those of fp64 are fp64.
  const bool wide = options_.compute_dtype == torch::kFloat64;
  if (wide) convert(stage);
  buffers_.reserve(options_.replicas);  // the update keeps a reference to the first
  buffers_.emplace_back(stage.models(), [&] {
    if (!wide) convert(stage);
  });
  if (!alone() && !resumed) {
    // Processors of different kinds may draw first weights that differ in a bit.
    ranks_->broadcast(buffers_.front().master());
    buffers_.front().publish();
  }
  update_ = std::make_unique<ParameterUpdate>(buffers_.front(), options_.update);
  if (resumed) restore(source, *resumed);
  open_shards();
  require_same_parameters(*ranks_, buffers_.front().master(), "at the start");
  // Replicas last: they share frozen weights, which a file or a checkpoint has filled. Their own initial values, which
  // are overwritten at once, must not count as draws of the run.
  at::Generator generator = at::detail::getDefaultCPUGenerator();
  const torch::Tensor draws = generator.get_state();
  for (std::size_t i = 1; i < options_.replicas; ++i) {
    owned_.push_back(stage.replica());
    convert(*owned_.back());
    stages_.push_back(owned_.back().get());
    buffers_.push_back(buffers_.front().share(owned_.back()->models()));
  }
  generator.set_state(draws);
  if (alone()) return;
  if (!resumed) restore_generator({});
  generator_saved_ = generator_state();
  GradientBuckets::Options buckets;
  buckets.overlap = options_.replicas == 1;
  buckets.bytes = ranks_->sum_bytes();
  buckets_ = std::make_unique<GradientBuckets>(buffers_.front(), *ranks_, buckets);
}

void Trainer::run() {
  try {
    train();
  } catch (const RankLost&) {
    save_what_is_complete();
    throw;
  }
}

void Trainer::train() {
  started_ = Clock::now();
  if (first()) {
    if (start_.begins_again) begin_again();
    metrics_ = std::make_unique<MetricsLog>(RunFolder{run_.output}.metrics(), step_);
    board_ = std::make_unique<TensorBoardWriter>(RunFolder{run_.output}.board(), last_kept_step() + 1);
  }
  data::Prefetcher::Options loading;
  loading.batch_size = options_.batch_size;
  loading.batch_split = options_.batch_split;
  loading.workers = options_.prefetch_data ? options_.num_workers_dl : 0;
  loading.rank = static_cast<std::size_t>(ranks_->rank());
  loading.ranks = static_cast<std::size_t>(ranks_->size());
  std::optional<data::Prefetcher> batches;
  batches.emplace(held_data(*stages_.front()), options_.seed, samples_, loading);

  std::optional<Progress> progress;  // a bar on a terminal; elsewhere the lines of print() say enough
  if (first() && ::isatty(STDERR_FILENO) != 0) {
    progress.emplace("training", static_cast<std::size_t>(options_.max_steps), "steps");
    progress->start_at(static_cast<std::size_t>(step_));
  }
  printed_at_ = Clock::now();
  const std::int64_t first_step = printed_step_ = step_;
  // A profile is a measurement: the run stops behind it, and the same command without it goes on.
  const std::int64_t end = run_.profile_steps > 0
                               ? std::min(options_.max_steps, first_step + kProfileWarmUp + run_.profile_steps)
                               : options_.max_steps;
  // By what all ranks know alike; later by what they agreed on in the step.
  bool out_of_time = options_.max_minutes > 0.0 && elapsed_before_ >= 60.0 * options_.max_minutes;
  if (first()) check_stop_rule();
  // Rank 0 alone reads the table of metrics.
  out_of_time = out_of_time || ranks_->gather(stalled_ ? "stalled" : "").front() == "stalled";
  while (step_ < end && !out_of_time) {
    ranks_->report(step_, Activity::kTraining);
    if (run_.profile_steps > 0 && first()) profile(step_ - first_step, /*last=*/false);
    const Clock::time_point begin = Clock::now();
    const data::StepBatches batch = next_batches(*batches);
    count_wait(begin);
    const StepVerdict verdict = train_step(batch);
    out_of_time = verdict.out_of_time;
    ++step_;
    if (progress) progress->advance();
    if (due(step_, options_.i_ddpcheck))
      require_same_parameters(*ranks_, buffers_.front().master(), "step " + std::to_string(step_));
    if (first() && due(step_, options_.i_print)) print();
    if (due(step_, options_.i_log)) log_means();
    if (first() && due(step_, options_.i_eval)) evaluate();
    if (first() && due(step_, options_.i_sample)) sample();
    // Data change together with a checkpoint that names them, so that a run that goes on sees the same.
    const Clock::time_point change = Clock::now();
    if (due(step_, options_.i_save) && step_ < options_.max_steps && take_newer_shards()) {
      batches.emplace(held_data(*stages_.front()), options_.seed, samples_, loading);
      count_wait(change);
    }
    if (due(step_, options_.i_save) || step_ == options_.before_decay) save();
    if (alone() ? interrupt_requested() : verdict.interrupted) {
      save();
      require_saved();
      ranks_->barrier();
      throw Interrupted("stopped at step " + std::to_string(step_) +
                        "; everything is saved, run the same command to go on");
    }
  }
  if (run_.profile_steps > 0 && first()) profile(step_ - first_step, /*last=*/true);
  const bool whole = run_.profile_steps == 0;
  // A run that had ended has this row already.
  if (first() && whole && options_.i_eval > 0 && !due(step_, options_.i_eval) &&
      !has_evaluation(metrics_->table(), step_))
    evaluate();
  save();
  if (first() && whole && options_.i_sample > 0 && step_ > first_step && !due(step_, options_.i_sample)) sample();
  require_saved();
  end_restart();
  ranks_->barrier();
}

Json Trainer::named_shards() const {
  const data::StreamGeneration& generation = *stages_.front()->data().generation;
  return {{"generation", generation.number}, {"shards", generation.shards}};
}

void Trainer::use_shards(const std::shared_ptr<const data::BatchSource>& source) {
  for (Stage* stage : stages_) stage->set_data(source);
  stream_->follow(source);
  const data::StreamGeneration& generation = *source->generation;
  log::info("step {}: the data are generation {} of the stream, shards {}", step_, generation.number,
            joined(generation.shards));
}

void Trainer::open_shards() {
  stream_ = stages_.front()->data().stream;
  if (!stream_) return;
  if (!start_.own) saved_shards_ = nullptr;  // those of another run
  const auto agreed = [this](const Json& own) {
    return parse_json(ranks_->gather(first() ? own.dump() : "").front(), "rank 0");
  };
  // Null on all ranks when one of them cannot have it.
  const auto open = [this](const Json& named) {
    auto source = named == named_shards() ? stages_.front()->data().shared_from_this()
                                          : stream_->open(named.at("generation").get<std::uint64_t>(),
                                                          named.at("shards").get<std::vector<std::uint64_t>>());
    for (const std::string& there : ranks_->gather(source ? "y" : "n")) {
      if (there != "y") source = nullptr;
    }
    return source;
  };
  const Json wanted = agreed(saved_shards_), now = agreed(named_shards());
  std::shared_ptr<const data::BatchSource> source = wanted.is_null() ? nullptr : open(wanted);
  if (!source && !wanted.is_null()) {
    log::warn(
        "shards {} of the stream, which the checkpoint of step {} names, are gone; the run goes on with generation {}, "
        "and differs from here on from one that was not stopped",
        wanted.at("shards").dump(), step_, now.at("generation").dump());
  }
  if (!source) source = open(now);
  if (!source) throw Error("the stream of shards changes faster than it can be read; start again");
  use_shards(source);
  if (!saved_shards_.is_null() && first()) stream_->mark_used(source->generation->number);
}

bool Trainer::take_newer_shards() {
  if (!stream_) return false;
  const std::shared_ptr<const data::BatchSource> next = stream_->newer();
  const std::string own = next ? std::to_string(next->generation->number) : "";
  for (const std::string& number : ranks_->gather(own)) {
    if (!number.empty() && number == own) continue;
    log::info("step {}: no newer shards are ready, the data stay", step_);
    return false;
  }
  use_shards(next);
  return true;
}

void Trainer::count_wait(Clock::time_point begin) {
  const double seconds = seconds_since(begin);
  times_.data += seconds;
  waited_ += seconds;
}

void Trainer::print() {
  const auto steps = static_cast<double>(step_ - printed_step_);
  const double each = seconds_since(printed_at_) / std::max(steps, 1.0);
  const double left = each * static_cast<double>(options_.max_steps - step_);
  const double waiting = std::exchange(waited_, 0.0) / std::max(each * steps, 1e-9);
  log::info(
      "step {}/{}: loss {:.5f}, {:.1f} ms per step, {:.1f} samples per second, {:.1f} % waiting for data, {:.0f} s; "
      "ends in about {:.0f} min",
      step_, options_.max_steps, last_loss_, each * 1e3,
      static_cast<double>(options_.batch_size) / std::max(each, 1e-9), 100.0 * waiting, elapsed(), left / 60.0);
  printed_at_ = Clock::now();
  printed_step_ = step_;
}

void Trainer::log_means() {
  bring_means_together();
  const StepTimes sums = std::exchange(times_, StepTimes());
  const double steps = static_cast<double>(std::max<std::int64_t>(std::exchange(timed_steps_, 0), 1));
  if (!first()) return;
  Values values = means_.means();
  const double data = sums.data / steps, forward = sums.forward / steps, backward = sums.backward / steps,
               update = sums.update / steps;
  for (const auto& [name, seconds] :
       {std::pair{"data", data}, {"forward", forward}, {"backward", backward}, {"update", update}}) {
    values.emplace_back(std::string("time.") + name + "_ms", seconds * 1e3);
  }
  const double communication = sums.communication / steps;
  if (!alone()) values.emplace_back("time.communication_ms", communication * 1e3);
  const double per_step = data + forward + backward + communication + update;
  values.emplace_back("time.data_share", data / std::max(per_step, 1e-9));
  values.emplace_back("time.samples_per_s", static_cast<double>(options_.batch_size) / std::max(per_step, 1e-9));
  values.emplace_back("time.elapsed_s", elapsed());
  metrics_->append(step_, values);
  for (auto [name, value] : values) {
    std::replace(name.begin(), name.end(), '.', '/');
    board_->scalar(name, value, step_);
  }
  board_->flush();
  means_.clear();
}

void Trainer::profile(std::int64_t steps_done, bool last) {
  const std::int64_t profiled = steps_done - kProfileWarmUp;
  if (profiled == 0 && !last) profile_ = std::make_unique<nn::OperatorProfile>();
  if (profile_ == nullptr || profiled < 1 || (profiled < run_.profile_steps && !last)) return;
  const std::string tables = nn::profile_markdown(profile_->rows(), profiled, nn::measure_machine_peak());
  profile_.reset();
  const std::filesystem::path file = RunFolder{run_.output}.profile();
  write_file_atomically(file, tables);
  log::info("where the time of {} steps went is in {}:\n{}", profiled, file.string(), tables);
}

void Trainer::evaluate() {
  const BusyRank busy(*ranks_, step_);
  Values values;
  {
    const AveragedWeights averaged(buffers_.front(), update_->ema);
    values = stages_.front()->evaluate();
  }
  std::string line;
  for (auto& [name, value] : values) {
    board_->scalar("eval/" + name, value, step_);
    line += ", " + name + " " + std::to_string(value);
    name = "eval." + name;
  }
  if (values.empty()) return;
  values.emplace_back("time.elapsed_s", elapsed());
  metrics_->append(step_, values);
  board_->flush();
  log::info("step {}: held-out{}", step_, line.substr(1));
  check_stop_rule();
  write_page();
}

void Trainer::check_stop_rule() {
  if (options_.stop_metric.empty()) return;
  if (!metrics_->table().rows.empty() && metrics_->table().column(options_.stop_metric) == CsvTable::kMissing)
    log::warn("stop_metric: no evaluation has given {} so far, so that it ends nothing", options_.stop_metric);
  stalled_ = has_stalled(metrics_->table(), options_.stop_metric, options_.stop_patience, options_.stop_gain);
  if (stalled_) {
    log::info("{} has gained less than {:.1f} % in {} evaluations: the run ends", options_.stop_metric,
              100.0 * options_.stop_gain, options_.stop_patience);
  }
}

void Trainer::write_page() const {
  const RunFolder run{run_.output};
  const RunFacts facts{run_.output.filename().string(), options_.max_steps, options_.batch_size};
  write_file_atomically(run.progress(), progress_page(run, metrics_->table(), facts));
}

void Trainer::sample() {
  const BusyRank busy(*ranks_, step_);
  const std::filesystem::path folder = RunFolder{run_.output}.samples() / ("step" + std::to_string(step_));
  {
    const AveragedWeights averaged(buffers_.front(), update_->ema);
    stages_.front()->sample(folder);
  }
  for (const std::filesystem::path& picture : pictures_in(folder)) {
    const std::string bytes = read_file(picture);
    const std::vector<std::uint8_t> png(bytes.begin(), bytes.end());
    const io::PictureSize size = io::probe_picture(png, picture.string());
    board_->image("samples/" + picture.stem().string(), png, static_cast<int>(size.width),
                  static_cast<int>(size.height), step_);
  }
  board_->flush();
  write_page();
}

double Trainer::elapsed() const { return elapsed_before_ + seconds_since(started_); }

void Trainer::train_micro_batches(const data::StepBatches& batches, const std::vector<std::size_t>& ours,
                                  std::vector<MicroBatch>& done) {
  const double scale = update_->loss_scale() / static_cast<double>(batches.size());
  workers_->run([&](std::size_t replica) {
    // Read when all work of the step is under way, so that a GPU never waits for its host in between.
    UnreadLosses unread;
    for (std::size_t k = replica; k < ours.size(); k += workers_->count()) {
      const std::size_t i = ours[k];
      log::debug("step {}, micro-batch {}: {}", step_, i, joined(batches[i]->ids));
      const Clock::time_point begin = Clock::now();
      const Losses losses = [&] {
        RECORD_USER_SCOPE("step: forward, the rest");
        return stages_[replica]->losses(*batches[i], {options_.seed, step_, i});
      }();
      unread.add(losses);
      const Clock::time_point middle = Clock::now();
      if (buckets_ && workers_->count() == 1 && k + 1 == ours.size()) buckets_->expect_last_backward();
      {
        RECORD_USER_SCOPE("step: backward, the rest");
        (losses.total * scale).backward();
      }
      if (replica != 0) continue;
      times_.forward += std::chrono::duration<double>(middle - begin).count();
      times_.backward += seconds_since(middle);
    }
    const Clock::time_point end = Clock::now();
    std::size_t k = replica;
    for (Values& values : unread.read()) {
      done[k].logged = std::move(values);
      judge_losses(batches[ours[k]]->ids, done[k]);
      k += workers_->count();
    }
    if (replica == 0) times_.backward += seconds_since(end);
  });
}

void Trainer::judge_losses(const std::vector<std::string>& ids, MicroBatch& done) const {
  for (const auto& [name, value] : done.logged) {
    done.finite = done.finite && std::isfinite(value);
    if (std::isfinite(value) || options_.update.loss_scaling || !done.problem.empty()) continue;
    done.problem = "step " + std::to_string(step_) + ": " + name + " is " + std::to_string(value) + " for samples " +
                   joined(ids) + "; nothing was updated, the last checkpoint is sound";
    // Other ranks wait for this one's gradients, whatever they are worth.
    if (alone()) throw Error(done.problem);
  }
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

StepVerdict Trainer::train_step(const data::StepBatches& batches) {
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
  for (const MicroBatch& each : done) {
    report.loss_sum += each.logged.front().second;
    report.bad_loss = report.bad_loss || !each.finite;
  }
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
  times_.update += seconds_since(begin) - (times_.communication - waited_before);
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

void Trainer::stop_at_gradient(const data::StepBatches& batches) {
  std::string own;
  if (alone() || !buckets_->own_gradients_finite()) {
    for (const auto& batch : batches) {
      if (batch) own += (own.empty() ? "" : ", ") + joined(batch->ids);
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
