#include <algorithm>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/experiment/plan.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;
using ExperimentPlan = ExperimentFolder;

bool has_pair(const std::vector<std::string>& command, const std::string& option, const std::string& value) {
  for (std::size_t i = 0; i + 1 < command.size(); ++i)
    if (command[i] == option && command[i + 1] == value) return true;
  return false;
}

TEST_F(ExperimentPlan, WhatVariantsAndSeedsShareIsOneJob) {
  const Plan p = plan(kTwoVariants);
  EXPECT_EQ(p.runs.size(), 4u);
  EXPECT_EQ(p.jobs.size(), 1u + 4u + 4u);  // one dataset, four trainings and their evaluations
  EXPECT_EQ(job_of(p, 0, "data").id, job_of(p, 3, "data").id);
  EXPECT_EQ(job_of(p, 0, "data").serves.size(), 4u);
  EXPECT_NE(job_of(p, 0, "fit").id, job_of(p, 1, "fit").id);
  EXPECT_NE(job_of(p, 0, "fit").id, job_of(p, 2, "fit").id);
}

TEST_F(ExperimentPlan, JobsComeAfterWhatTheyNeed) {
  const Plan p = plan(R"({"title": "x", "steps": {
    "score": {"program": "anigen-eval", "args": {"--pred": "{fit}"}},
    "fit": {"program": "anigen-train", "config": "train.json", "after": ["latents"], "args": {"--dataset": "{data}"}},
    "latents": {"program": "anigen-encode", "words": ["ss"], "writes_into": "data", "args": {"--dataset": "{data}"}},
    "data": {"program": "anigen-prepare"}}})");
  ASSERT_EQ(p.jobs.size(), 4u);
  for (std::size_t j = 0; j < p.jobs.size(); ++j)
    for (const std::size_t need : p.jobs[j].needs) EXPECT_LT(need, j);
  EXPECT_EQ(job_of(p, 0, "latents").folder, job_of(p, 0, "data").folder);
  EXPECT_EQ(job_of(p, 0, "latents").command.at(1), "ss");
}

TEST_F(ExperimentPlan, GoalsLeaveOutWhatNothingNeeds) {
  const std::string steps = R"("steps": {
    "data": {"program": "anigen-prepare"}, "other": {"program": "anigen-prepare", "args": {"--procedural": 1}},
    "fit": {"program": "anigen-train", "config": "train.json", "args": {"--dataset": "{data}"}},
    "score": {"program": "anigen-eval", "args": {"--pred": "{fit}"}}})";
  EXPECT_EQ(plan(R"({"title": "x", )" + steps + "}").jobs.size(), 4u);
  EXPECT_EQ(plan(R"({"title": "x", "goals": ["fit"], )" + steps + "}").jobs.size(), 2u);
  EXPECT_EQ(
      plan(R"({"title": "x", "goals": [], "curves": [{"title": "c", "step": "fit", "column": "l"}], )" + steps + "}")
          .jobs.size(),
      2u);
}

TEST_F(ExperimentPlan, CommandsCarryFoldersSettingsAndSeeds) {
  const Plan p = plan(kTwoVariants);
  const Job& fit = job_of(p, 3, "fit");  // variant fast, seed 1
  EXPECT_EQ(fit.command.front(), (folder_ / "bin/anigen-train").string());
  EXPECT_TRUE(has_pair(fit.command, "--dataset", job_of(p, 3, "data").folder.string()));
  EXPECT_TRUE(has_pair(fit.command, "--output", (folder_ / "out" / "jobs" / fit.id).string()));
  EXPECT_TRUE(has_pair(fit.command, "--set", "trainer.args.lr=2"));
  EXPECT_TRUE(has_pair(fit.command, "--seed", "1"));
  EXPECT_TRUE(has_pair(job_of(p, 0, "score").command, "--pred", "ours=" + job_of(p, 0, "fit").folder.string()));
  EXPECT_EQ(std::count(fit.command.begin(), fit.command.end(), "--threads"), 0);
}

TEST_F(ExperimentPlan, ListsRepeatFlagsStandAloneAndTextsThatAreJsonKeepTheirQuotes) {
  const Plan p = plan(R"({"title": "x", "steps": {"a": {"program": "anigen-train", "config": "train.json",
    "set": {"p": "12", "q": "5%", "r": [1, 2], "s": true},
    "args": {"--two": ["x", 3], "--yes": true, "--no": false, "--none": null}}}})");
  const std::vector<std::string>& command = p.jobs[0].command;
  EXPECT_TRUE(has_pair(command, "--two", "x"));
  EXPECT_TRUE(has_pair(command, "--two", "3"));
  EXPECT_EQ(std::count(command.begin(), command.end(), "--yes"), 1);
  EXPECT_EQ(std::count(command.begin(), command.end(), "--no"), 0);
  EXPECT_EQ(std::count(command.begin(), command.end(), "--none"), 0);
  for (const char* setting : {"p=\"12\"", "q=5%", "r=[1,2]", "s=true"})
    EXPECT_TRUE(has_pair(command, "--set", setting));
}

TEST_F(ExperimentPlan, NullTakesSettingsBack) {
  const auto settings_of = [&](const std::string& changes) {
    const Plan p = plan(R"({"title": "x", "steps": {"a": {"program": "anigen-train", "config": "train.json",
      "set": {"p": {"q": 1, "r": 2}}}}, "variants": {"v": {"a": )" +
                        changes + "}}}");
    std::string settings;
    const std::vector<std::string>& command = p.jobs[0].command;
    for (std::size_t i = 0; i + 1 < command.size(); ++i)
      if (command[i] == "--set") settings += command[i + 1] + " ";
    return settings;
  };
  EXPECT_EQ(settings_of("{}"), "p.q=1 p.r=2 ");
  EXPECT_EQ(settings_of(R"({"set": {"p.q": null, "p": {"s": 3}}})"), "p.r=2 p.s=3 ");
  EXPECT_EQ(settings_of(R"({"set": null})"), "");
}

TEST_F(ExperimentPlan, AStepWithoutTheExperimentsSeedsMayHaveItsOwn) {
  const auto with = [](const std::string& more) {
    return R"({"title": "x", "steps": {"a": {"program": "anigen-prepare", "args": {"--seed": 7}}})" + more + "}";
  };
  EXPECT_TRUE(has_pair(plan(with("")).jobs[0].command, "--seed", "7"));
  EXPECT_NE(error_of([&] { plan(with(R"(, "seeded": ["a"])")); }).find("--seed"), std::string::npos);
}

TEST_F(ExperimentPlan, OnlyProgramsThatComputeOnTheDeviceAreTold) {
  place_.device = "cuda:1";
  program("anigen-rig", "#!/bin/sh\n");
  const Plan p = plan(R"({"title": "x", "steps": {
    "plain": {"program": "anigen-prepare", "args": {"--procedural": 3}},
    "features": {"program": "anigen-prepare", "args": {"--procedural": 3, "--features": "dinov2_vits14_reg"}},
    "surface": {"program": "anigen-prepare", "args": {"--procedural": 3, "--features": "surface"}},
    "fit": {"program": "anigen-train", "config": "train.json", "args": {"--dataset": "{plain}"}},
    "latents": {"program": "anigen-encode", "words": ["ss"], "writes_into": "plain", "args": {"--dataset": "{plain}"}},
    "embedded": {"program": "anigen-rig", "args": {"--method": "pinocchio", "--mesh": "{plain}"}},
    "learned": {"program": "anigen-rig", "args": {"--method": "anymate", "--mesh": "{plain}"}},
    "score": {"program": "anigen-eval", "args": {"--pred": "{fit}"}},
    "weights": {"program": "anigen-eval", "args": {"--skin-ae": "{fit}"}}}})");
  for (const char* step : {"features", "fit", "latents", "learned", "weights"})
    EXPECT_TRUE(has_pair(job_of(p, 0, step).command, "--device", "cuda:1")) << step;
  for (const char* step : {"plain", "surface", "embedded", "score"}) {
    const std::vector<std::string>& command = job_of(p, 0, step).command;
    EXPECT_EQ(std::count(command.begin(), command.end(), "--device"), 0) << step;
  }
}

// A week of training does not start again because of a commit that changed another program.
TEST_F(ExperimentPlan, TheCommitOfAProgramIsNotItsCode) {
  const auto key_of = [&](const std::string& bytes) {
    program("anigen-train", bytes);
    return job_of(plan(kTwoVariants), 0, "fit").key;
  };
  const auto stamped = [](std::string commit) {
    commit.resize(49, '\0');
    return "anigen commit: " + commit;
  };
  const std::string note("\4\0\0\0\24\0\0\0\3\0\0\0GNU\0", 16);
  const std::string before = key_of("code" + stamped("1111111111") + "more" + note + std::string(20, 'a') + "rest");
  EXPECT_EQ(before, key_of("code" + stamped("2222222222+changes") + "more" + note + std::string(20, 'b') + "rest"));
  EXPECT_NE(before, key_of("code" + stamped("1111111111") + "less" + note + std::string(20, 'a') + "rest"));
  EXPECT_NE(before, key_of("code" + stamped("1111111111") + "more" + note + std::string(20, 'a') + "test"));
}

TEST_F(ExperimentPlan, CodeOfTheModulesThatProgramsLoadCounts) {
  program("anigen-train", "code");
  for (const char* name : {"anigen-torch.so", "anigen-opencv.so"}) {
    const fs::path module = folder_ / "lib/anigen" / name;
    const auto key_with = [&](const std::string& bytes) {
      fs::create_directories(module.parent_path());
      std::ofstream(module, std::ios::binary) << bytes;
      return job_of(plan(kTwoVariants), 0, "fit").key;
    };
    const std::string without = job_of(plan(kTwoVariants), 0, "fit").key, first = key_with("layers");
    EXPECT_NE(without, first) << name;
    EXPECT_NE(first, key_with("other layers")) << name;
  }
}

TEST_F(ExperimentPlan, AChangeRenamesJustWhatDependsOnIt) {
  const Plan before = plan(kTwoVariants);
  std::string changed = kTwoVariants;
  changed.replace(changed.find("lr\": 2"), 6, "lr\": 7");
  const Plan after = plan(changed);
  EXPECT_EQ(job_of(before, 0, "data").key, job_of(after, 0, "data").key);
  EXPECT_EQ(job_of(before, 0, "fit").key, job_of(after, 0, "fit").key);
  EXPECT_EQ(job_of(before, 0, "score").key, job_of(after, 0, "score").key);
  EXPECT_NE(job_of(before, 2, "fit").key, job_of(after, 2, "fit").key);
  EXPECT_NE(job_of(before, 2, "score").key, job_of(after, 2, "score").key);
}

TEST_F(ExperimentPlan, TheConfigFilesContentCountsAndItsNameDoesNot) {
  const Plan before = plan(kTwoVariants);
  write("train.json", R"({"trainer": {"args": {"steps": 5, "lr": 1}}})");  // the same in another order
  EXPECT_EQ(job_of(before, 0, "fit").key, job_of(plan(kTwoVariants), 0, "fit").key);
  write("train.json", R"({"trainer": {"args": {"steps": 6, "lr": 1}}})");
  EXPECT_NE(job_of(before, 0, "fit").key, job_of(plan(kTwoVariants), 0, "fit").key);
}

TEST_F(ExperimentPlan, NamedInputsCount) {
  const std::string json =
      R"({"title": "x", "steps": {"a": {"program": "anigen-prepare", "args": {"--input": "{path:rigs}"}}}})";
  EXPECT_NE(error_of([&] { plan(json); }).find("no such file or folder"), std::string::npos);
  fs::create_directories(folder_ / "rigs");
  write("rigs/a.glb", "one");
  const Plan before = plan(json);
  EXPECT_TRUE(has_pair(before.jobs[0].command, "--input", (folder_ / "rigs").string()));
  EXPECT_EQ(before.jobs[0].key, plan(json).jobs[0].key);
  write("rigs/b.glb", "two");
  EXPECT_NE(before.jobs[0].key, plan(json).jobs[0].key);
}

TEST_F(ExperimentPlan, MistakesAreNamed) {
  const auto error = [&](const std::string& args) {
    return error_of([&] {
      plan(R"({"title": "x", "steps": {"a": {"program": "anigen-prepare", "args": {"--b": ")" + args +
           R"("}}, "data": {"program": "anigen-prepare", "args": {"--c": "{a}"}}}})");
    });
  };
  EXPECT_NE(error("{dat}").find("did you mean '{data}'"), std::string::npos);
  EXPECT_NE(error("{data}").find("wait for each other"), std::string::npos);
  EXPECT_NE(error("{data").find("without '}'"), std::string::npos);
  fs::remove(folder_ / "bin/anigen-prepare");
  EXPECT_NE(error("x").find("no such program"), std::string::npos);
}

TEST(Placeholders, BracesCanBeWritten) {
  const Meaning meaning = [](const std::string& inside) { return "<" + inside + ">"; };
  EXPECT_EQ(filled_in(std::string("a{b}c{{d}{e.name}"), meaning), "a<b>c{d}<e.name>");
  EXPECT_EQ(filled_in(Json{{"k", {"{x}", 3}}}, meaning), (Json{{"k", {"<x>", 3}}}));
}

TEST(ShellLine, QuotesWhatAShellWouldReadOtherwise) {
  EXPECT_EQ(shell_line({"/bin/x", "a b", "it's", "", "k=[1]"}), R"(/bin/x 'a b' 'it'\''s' '' 'k=[1]')");
}

}  // namespace

namespace {

namespace fs = std::filesystem;

/// Those of the folder itself and, claim by claim, of the papers.
std::vector<fs::path> shipped() {
  std::vector<fs::path> files;
  for (const char* folder : {"experiments", "experiments/paper"}) {
    for (const auto& entry : fs::directory_iterator(test::source_dir() / folder))
      if (entry.path().extension() == ".json" && !read_collection(entry.path())) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

class ShippedExperiments : public ExperimentFolder {};

TEST_F(ShippedExperiments, AreReadAndPlanned) {
  for (const char* name : {"anigen-generate", "anigen-rig", "anigen-animate"}) program(name, "#!/bin/bash\n");
  ASSERT_GE(shipped().size(), 5u);
  for (const fs::path& file : shipped()) {
    SCOPED_TRACE(file.filename());
    const Experiment e = read_experiment(file);
    if (read_file(file).find("{path:../rigs}") != std::string::npos && !fs::exists(test::source_dir() / "rigs")) {
      EXPECT_NE(error_of([&] { make_plan(e, place_); }).find("rigs: no such file or folder"), std::string::npos);
      continue;
    }
    const Plan p = make_plan(e, place_);
    EXPECT_EQ(p.runs.size(), e.variants.size() * e.seeds.size());
    EXPECT_FALSE(e.purpose.empty());
    EXPECT_FALSE(e.tables.empty() && e.costs.empty());
    // Variants of an ablation share what lies before the ablated stage.
    if (e.variants.size() > 1) {
      EXPECT_EQ(job_of(p, 0, "dataset").serves.size(), p.runs.size());
    }
  }
}

TEST_F(ShippedExperiments, OfThePapersHaveClaimsAndScalesAndAreCollected) {
  for (const char* name : {"anigen-generate", "anigen-rig", "anigen-animate"}) program(name, "#!/bin/bash\n");
  const fs::path folder = test::source_dir() / "experiments/paper";
  const auto all = read_collection(folder / "all.json");
  ASSERT_TRUE(all.has_value());
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(folder)) files += entry.path().extension() == ".json" ? 1 : 0;
  EXPECT_EQ(all->files.size(), files - 1);
  for (const fs::path& file : all->files) {
    SCOPED_TRACE(file.filename());
    const Experiment small = read_experiment(file, {}, "small"), tiny = read_experiment(file, {}, "tiny");
    EXPECT_FALSE(small.claims.empty());
    EXPECT_EQ(small.seeds.size(), 3u);
    EXPECT_EQ(tiny.seeds.size(), 1u);
    double minutes = 0;
    const Plan plan = make_plan(tiny, place_);
    for (const Job& job : plan.jobs) minutes += job.minutes;
    EXPECT_LT(minutes, 30);
    EXPECT_LT(plan.jobs.size(), make_plan(small, place_).jobs.size());
  }
}

TEST_F(ShippedExperiments, AnAblationRunsOnlyWhatItsTableNeeds) {
  const Plan p = make_plan(read_experiment(test::source_dir() / "experiments/ablation_adapters.json"), place_);
  // Dataset, auto-encoder and latents once; flow and evaluation for three variants with three seeds.
  EXPECT_EQ(p.jobs.size(), 3u + 9u * 2u);
}

// docs/full_size.md and experiments.md promise it: 1,000 test assets, and latents normalised as the published config
// does: geometry alone, skin and skeleton as they are.
TEST_F(ShippedExperiments, ThePublishedOneSplitsAndNormalisesAsPublished) {
  const Json json = read_json(test::source_dir() / "experiments/published.json");
  const Json& prepare = json["steps"]["dataset"]["args"];
  EXPECT_EQ(prepare.value("--test-count", 0), 1000);
  EXPECT_FALSE(prepare.contains("--test-fraction"));
  const Json& flow = json["steps"]["slat_flow"]["set"]["dataset.args"];
  EXPECT_EQ(flow.value("normalization", ""), "latents/{slat_dae.name}_statistics.json");
  const Json& structure = json["steps"]["ss_flow"]["set"]["dataset.args"];
  EXPECT_FALSE(structure.contains("normalization")) << "the published stage 4 has none";
  // The config that the statistics take the place of is about the geometry alone, too.
  const Json published = read_json(test::source_dir() / "configs/published/slat_flow_auto.json");
  const Json& lists = published["dataset"]["args"]["normalization"];
  for (std::size_t c = 8; c < 16; ++c) EXPECT_EQ(lists["std"][c], 1);
}

}  // namespace

}  // namespace anigen::experiment
