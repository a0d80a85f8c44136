#include "tests/train/stages/flow_run.h"

#include <cmath>
#include <filesystem>
#include <numeric>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "anigen/train/train_command.h"
#include "tests/train/distributed/rank_outcomes.h"
#include "tests/train/stages/stage_of_config.h"

namespace anigen::test {

using train::Stage;

FlowRun::FlowRun(std::string config) : config_(std::move(config)) {
  write_file_atomically(sample_.root() / "held_out.txt", PublishedSample::id(PublishedSample::kAssets - 1) + "\n");
  write_file_atomically(folder_ / "config.json", config_);
}

train::TrainCommand FlowRun::command(const std::string& output, std::vector<std::string> overrides) {
  return train_command(folder_, output, std::move(overrides));
}

std::unique_ptr<Stage> FlowRun::fresh_stage(const std::vector<std::string>& overrides) {
  return stage_of_config(config_, sample_.root(), overrides);
}

train::TrainerOptions FlowRun::trainer_options(const std::vector<std::string>& overrides) const {
  Json config = parse_json(config_, "test");
  apply_overrides(config, overrides);
  ConfigReader args(config.at("trainer").at("args"), "test", "/trainer/args");
  return train::TrainerOptions::read(args);
}

std::unique_ptr<Stage> FlowRun::stage(const std::vector<std::string>& overrides) {
  auto made = fresh_stage(overrides);
  draw_weights(*made);
  return made;
}

std::string FlowRun::message(const std::vector<std::string>& overrides) {
  try {
    fresh_stage(overrides);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

std::unique_ptr<data::Batch> FlowRun::batch_of(const Stage& stage) {
  return stage.data().load({data::Draw{0, 0}, data::Draw{1, 1}});
}

double FlowRun::term(const train::Losses& losses, const std::string& name) {
  for (const auto& [known, value] : losses.terms) {
    if (known == name) return value.item<double>();
  }
  ADD_FAILURE() << "no term " << name;
  return NAN;
}

std::string FlowRun::bytes(const std::string& file) { return read_file(folder_ / file); }

io::Image FlowRun::sample_sheet(const std::string& run, int step) {
  std::string events;
  for (const auto& file : std::filesystem::directory_iterator(folder_ / (run + "/tb_logs")))
    events += read_file(file.path());
  EXPECT_NE(events.find("samples/samples"), std::string::npos);
  EXPECT_NE(events.find("\x89PNG"), std::string::npos);
  return io::read_image(folder_ / (run + "/samples/step" + std::to_string(step) + "/samples.png"));
}

void FlowRun::expect_draws_named_by_seed_step_and_micro_batch() {
  const auto one = stage(), two = stage();
  const auto batch = batch_of(*one);
  const double first = total_loss(one->losses(*batch, {5, 7, 1}));
  torch::manual_seed(123);
  torch::randn({100});
  EXPECT_EQ(total_loss(two->losses(*batch, {5, 7, 1})), first);
  EXPECT_NE(total_loss(two->losses(*batch, {5, 7, 0})), first);
  EXPECT_NE(total_loss(two->losses(*batch, {5, 8, 1})), first);
  EXPECT_NE(total_loss(two->losses(*batch, {6, 7, 1})), first);
}

void FlowRun::expect_dropped_conditions_not_to_see_the_picture(const data::Batch& batch, torch::Tensor& cond) {
  const auto always = stage({"trainer.args.p_uncond=1"}), never = stage({"trainer.args.p_uncond=0"});
  const double dropped = total_loss(always->losses(batch, {5, 0, 0})),
               kept = total_loss(never->losses(batch, {5, 0, 0}));
  EXPECT_NE(dropped, kept);
  cond = 1.0 - cond;
  EXPECT_EQ(total_loss(always->losses(batch, {5, 0, 0})), dropped);
  EXPECT_NE(total_loss(never->losses(batch, {5, 0, 0})), kept);
}

void FlowRun::expect_frozen_branches_to_start_warm(const std::string& pretrained) {
  const std::vector<std::string> frozen = {"models.denoiser.args.use_pretrain_branch=true",
                                           "models.denoiser.args.freeze_pretrain_branch=true"};
  EXPECT_THROW(stage(frozen)->warm_start({}), InputError) << "a frozen branch without its warm start";
  const auto open = stage({frozen[0], frozen[1], "trainer.args.warm_start=none"});
  for (const auto& parameter : open->models().front().module->named_parameters())
    EXPECT_TRUE(parameter.value().requires_grad()) << parameter.key() << ": nothing is frozen without a warm start";
  io::write_safetensors(folder_ / (pretrained + ".safetensors"), nn::state_dict(*open->models().front().module));
  const auto flow = stage({frozen[0], frozen[1], "trainer.args.pretrained_dir=" + folder_.path().string()});
  flow->warm_start({});
  const auto twin = flow->replica();
  train::ParameterBuffer buffer(flow->models());
  const train::ParameterBuffer shared = buffer.share(twin->models());
  EXPECT_LT(buffer.slots().size(), flow->models().front().module->parameters().size());
  const auto batch = batch_of(*flow);
  EXPECT_EQ(total_loss(twin->losses(*batch, {5, 0, 0})), total_loss(flow->losses(*batch, {5, 0, 0})));
}

void FlowRun::expect_falling_loss(const std::vector<std::string>& columns) {
  train::train(command("run", {"trainer.args.max_steps=200", "trainer.args.i_log=20", "trainer.args.i_save=200",
                               "trainer.args.i_eval=100"}));
  const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
  for (const std::string& column : columns) EXPECT_NE(metrics.column(column), CsvTable::kMissing) << column;
  std::vector<double> losses;
  for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
    if (!metrics.cell(row, "loss.total").empty()) losses.push_back(std::stod(metrics.cell(row, "loss.total")));
  }
  // Every row is the mean over 20 steps of 4 assets at random times; thirds of the run smooth that further.
  const auto third = static_cast<std::ptrdiff_t>(losses.size() / 3);
  ASSERT_GT(third, 0);
  EXPECT_LT(std::accumulate(losses.end() - third, losses.end(), 0.0),
            std::accumulate(losses.begin(), losses.begin() + third, 0.0));
  for (const char* file : {"ckpts/denoiser_step0000200.safetensors", "ckpts/image_encoder_step0000200.safetensors"})
    EXPECT_TRUE(std::filesystem::exists(folder_ / "run" / file)) << file;
}

void FlowRun::expect_same_bits_after_resuming(const std::vector<std::string>& given) {
  for (const std::string& precision : {std::string("fp32"), std::string("bf16")}) {
    std::vector<std::string> overrides{"trainer.args.precision=" + precision, "trainer.args.replicas=2"};
    overrides.insert(overrides.end(), given.begin(), given.end());
    std::vector<std::string> leg = overrides;
    leg.push_back("trainer.args.max_steps=8");
    train::train(command(precision + "_whole", overrides));
    train::train(command(precision + "_legs", leg));
    train::train(command(precision + "_legs", overrides));
    for (const char* name : {"denoiser", "denoiser_ema0.9", "image_encoder", "image_encoder_ema0.9"}) {
      const std::string file = std::string("ckpts/") + name + "_step0000012.safetensors";
      EXPECT_EQ(bytes(precision + "_whole/" + file), bytes(precision + "_legs/" + file)) << file;
    }
  }
  EXPECT_NE(bytes("fp32_whole/ckpts/denoiser_step0000012.safetensors"),
            bytes("bf16_whole/ckpts/denoiser_step0000012.safetensors"));
}

void FlowRun::expect_close_bf16_with_full_masters() {
  const auto plain = stage(), reduced = stage();
  const auto batch = batch_of(*plain);
  train::ParameterBuffer buffer(reduced->models(), [&] { reduced->set_compute_dtype(torch::kBFloat16); });
  const double expected = total_loss(plain->losses(*batch, {5, 0, 0})),
               found = total_loss(reduced->losses(*batch, {5, 0, 0}));
  EXPECT_NE(found, expected);
  EXPECT_NEAR(found, expected, 0.05 * expected) << "bf16 has 8 bits of mantissa";
  std::vector<torch::Tensor> full;
  for (const nn::NamedModel& model : plain->models()) {
    for (const torch::Tensor& parameter : model.module->parameters()) full.push_back(parameter.detach().reshape({-1}));
  }
  EXPECT_TRUE(torch::equal(buffer.master(), torch::cat(full))) << "masters keep what bf16 rounds away";
  EXPECT_THROW(train::train(command("fp16", {"trainer.args.precision=fp16-published"})), NotSupportedError);
}

void FlowRun::expect_the_same_on_several_ranks() {
  expect_ranks_agree([this] { return stage(); }, trainer_options({"trainer.args.batch_split=4"}), folder_ / "ranks");
}

}  // namespace anigen::test
