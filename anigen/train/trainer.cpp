#include "anigen/train/trainer.h"

#include <ATen/CPUGeneratorImpl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/progress.h"
#include "anigen/io/image_probe.h"

namespace anigen::train {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

bool due(std::int64_t step, std::int64_t every) { return every > 0 && step % every == 0; }

std::string joined_ids(const loaders::Batch& batch) {
  std::string line;
  for (const std::string& id : batch.ids) line += (line.empty() ? "" : ", ") + id;
  return line;
}

bool finite_losses(const std::vector<Values>& logged) {
  for (const Values& values : logged) {
    for (const auto& entry : values) {
      if (!std::isfinite(entry.second)) return false;
    }
  }
  return true;
}

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

loaders::StepBatches next_batches(loaders::Prefetcher& batches) {
  RECORD_USER_SCOPE("step: waiting for data");
  return batches.next();
}

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
    : options_(options), run_(run), stages_{&stage}, checkpoints_(run.output / "ckpts"), started_(Clock::now()) {
  if (options_.replicas > options_.batch_split) {
    throw InputError("", "trainer/args/replicas", "needs a batch_split of at least as many micro-batches");
  }
  workers_ =
      std::make_unique<Workers>(options_.replicas, std::max(1, run.threads / static_cast<int>(options_.replicas)));
  check_finetuned_models();
  const CheckpointFolder source((run_.load.empty() ? run_.output : run_.load) / "ckpts");
  const std::optional<std::int64_t> resumed = step_to_restore(source);
  if (!resumed) start_from_files();
  const auto convert = [this](Stage& converted) {
    if (options_.compute_dtype != torch::kFloat32) converted.set_compute_dtype(options_.compute_dtype);
  };
  buffers_.reserve(options_.replicas);  // the update keeps a reference to the first
  buffers_.emplace_back(stage.models(), [&] { convert(stage); });
  update_ = std::make_unique<ParameterUpdate>(buffers_.front(), options_.update);
  if (resumed) restore(source, *resumed);
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
}

Trainer::~Trainer() = default;

void Trainer::run() {
  started_ = Clock::now();
  metrics_ = std::make_unique<MetricsLog>(run_.output / "metrics.csv", step_);
  board_ = std::make_unique<TensorBoardWriter>(run_.output / "tb_logs", step_ + 1);
  loaders::Prefetcher::Options loading;
  loading.batch_size = options_.batch_size;
  loading.batch_split = options_.batch_split;
  loading.workers = options_.prefetch_data ? options_.num_workers_dl : 0;
  loaders::Prefetcher batches(stages_.front()->data(), options_.seed, samples_, loading);

  std::optional<Progress> progress;  // a bar on a terminal; elsewhere the lines of print() say enough
  if (::isatty(STDERR_FILENO) != 0) {
    progress.emplace("training", static_cast<std::size_t>(options_.max_steps), "steps");
    progress->start_at(static_cast<std::size_t>(step_));
  }
  printed_at_ = Clock::now();
  const std::int64_t first_step = printed_step_ = step_;
  while (step_ < options_.max_steps && !out_of_time()) {
    if (run_.profile_steps > 0) profile(step_ - first_step);
    const Clock::time_point begin = Clock::now();
    const loaders::StepBatches batch = next_batches(batches);
    times_.data += seconds_since(begin);
    train_step(batch);
    ++step_;
    if (progress) progress->advance();
    if (due(step_, options_.i_print)) print();
    if (due(step_, options_.i_log)) log_means();
    if (due(step_, options_.i_eval)) evaluate();
    if (due(step_, options_.i_sample)) sample();
    if (due(step_, options_.i_save)) save();
    if (interrupt_requested()) {
      save();
      throw Interrupted("stopped at step " + std::to_string(step_) +
                        "; everything is saved, run the same command to go on");
    }
  }
  if (run_.profile_steps > 0) profile(step_ - first_step);
  if (options_.i_eval > 0 && !due(step_, options_.i_eval)) evaluate();
  save();
  if (options_.i_sample > 0 && step_ > first_step && !due(step_, options_.i_sample)) sample();
}

void Trainer::train_step(const loaders::StepBatches& batches) {
  for (ParameterBuffer& buffer : buffers_) buffer.zero_gradients();
  const double scale = update_->loss_scale() / static_cast<double>(batches.size());
  std::vector<Values> logged(batches.size());
  workers_->run([&](std::size_t replica) {
    for (std::size_t i = replica; i < batches.size(); i += workers_->count()) {
      const Clock::time_point begin = Clock::now();
      const Losses losses = [&] {
        RECORD_USER_SCOPE("step: forward, the rest");
        return stages_[replica]->losses(*batches[i], {options_.seed, step_, i});
      }();
      logged[i].emplace_back("loss.total", losses.total.item<double>());
      for (const auto& [name, term] : losses.terms) logged[i].emplace_back("loss." + name, term.item<double>());
      for (const auto& [name, value] : logged[i]) {
        if (std::isfinite(value) || options_.update.loss_scaling) continue;
        throw Error("step " + std::to_string(step_) + ": " + name + " is " + std::to_string(value) + " for samples " +
                    joined_ids(*batches[i]) + "; nothing was updated, the last checkpoint is sound");
      }
      const Clock::time_point middle = Clock::now();
      {
        RECORD_USER_SCOPE("step: backward, the rest");
        (losses.total * scale).backward();
      }
      if (replica != 0) continue;
      times_.forward += std::chrono::duration<double>(middle - begin).count();
      times_.backward += seconds_since(middle);
    }
  });
  const Clock::time_point begin = Clock::now();
  RECORD_USER_SCOPE("step: update of the weights");
  for (ParameterBuffer& buffer : buffers_) buffer.collect_gradients();
  torch::Tensor gradient = buffers_.front().gradient();
  for (std::size_t i = 1; i < buffers_.size(); ++i) gradient.add_(buffers_[i].gradient());
  // Under loss scaling such a step is skipped, also where the loss overflows and its gradient does not.
  if (!finite_losses(logged)) gradient.fill_(std::numeric_limits<double>::quiet_NaN());
  const ParameterUpdate::Result result = update_->apply(step_);
  if (result.skipped && !options_.update.loss_scaling) {
    std::string ids;
    for (const auto& batch : batches) ids += (ids.empty() ? "" : ", ") + joined_ids(*batch);
    throw Error("step " + std::to_string(step_) + ": the gradient of " + buffers_.front().first_not_finite(gradient) +
                " is not finite for samples " + ids + "; nothing was updated, the last checkpoint is sound");
  }
  if (result.restored) {
    log::warn("step {}: the update left weights that are not finite; training goes on with those of step {}", step_,
              update_->recovery.step());
  }
  for (std::size_t i = 1; i < buffers_.size(); ++i) buffers_[i].publish();
  times_.update += seconds_since(begin);
  ++timed_steps_;
  for (const loaders::StepBatches::value_type& batch : batches) samples_ += batch->ids.size();
  last_loss_ = 0.0;
  for (const Values& values : logged) {
    last_loss_ += values.front().second / static_cast<double>(logged.size());
    for (const auto& [name, value] : values) means_.add(name, value);
  }
  means_.add("status.grad_norm", result.grad_norm);
  means_.add("status.lr", result.lr);
  if (update_->clipper) means_.add("status.clip_at", update_->clipper->threshold());
  if (options_.update.loss_scaling) means_.add("status.log_scale", update_->log_scale);
}

void Trainer::print() {
  const auto steps = static_cast<double>(step_ - printed_step_);
  const double each = seconds_since(printed_at_) / std::max(steps, 1.0);
  log::info("step {}/{}: loss {:.5f}, {:.1f} ms per step, {:.0f} samples per second, {:.0f} s", step_,
            options_.max_steps, last_loss_, each * 1e3, static_cast<double>(options_.batch_size) / std::max(each, 1e-9),
            elapsed());
  printed_at_ = Clock::now();
  printed_step_ = step_;
}

void Trainer::log_means() {
  Values values = means_.means();
  const double steps = static_cast<double>(std::max<std::int64_t>(timed_steps_, 1));
  const double data = times_.data / steps, forward = times_.forward / steps, backward = times_.backward / steps,
               update = times_.update / steps;
  for (const auto& [name, seconds] :
       {std::pair{"data", data}, {"forward", forward}, {"backward", backward}, {"update", update}}) {
    values.emplace_back(std::string("time.") + name + "_ms", seconds * 1e3);
  }
  const double per_step = data + forward + backward + update;
  values.emplace_back("time.samples_per_s", static_cast<double>(options_.batch_size) / std::max(per_step, 1e-9));
  values.emplace_back("time.elapsed_s", elapsed());
  metrics_->append(step_, values);
  for (auto [name, value] : values) {
    std::replace(name.begin(), name.end(), '.', '/');
    board_->scalar(name, value, step_);
  }
  board_->flush();
  means_.clear();
  times_ = StepTimes();
  timed_steps_ = 0;
}

void Trainer::profile(std::int64_t steps_done) {
  constexpr std::int64_t kWarmUp = 2;
  const std::int64_t profiled = steps_done - kWarmUp;
  if (profiled == 0 && step_ < options_.max_steps) profile_ = std::make_unique<nn::OperatorProfile>();
  const bool last = step_ == options_.max_steps || out_of_time();
  if (profile_ == nullptr || profiled < 1 || (profiled < run_.profile_steps && !last)) return;
  const std::string tables = nn::profile_markdown(profile_->rows(), profiled);
  profile_.reset();
  const std::filesystem::path file = run_.output / "profile.md";
  write_file_atomically(file, tables);
  log::info("where the time of {} steps went is in {}:\n{}", profiled, file.string(), tables);
}

void Trainer::evaluate() {
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
}

void Trainer::sample() {
  const std::filesystem::path folder = run_.output / "samples" / ("step" + std::to_string(step_));
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
}

bool Trainer::out_of_time() const { return options_.max_minutes > 0.0 && elapsed() >= 60.0 * options_.max_minutes; }

double Trainer::elapsed() const { return elapsed_before_ + seconds_since(started_); }

}  // namespace anigen::train
