#include "anigen/experiment/method_costs.h"

#include <gtest/gtest.h>

#include <string>

#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/experiment/claims.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/run_jobs.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

class MethodCosts : public ExperimentFolder {
 protected:
  MethodCosts() { log::setup("off"); }

  // A mesh generator, and a rigger behind it whose model has two parts.
  static std::string with_costs(const std::string& claims) {
    return R"({
      "title": "Costs",
      "steps": {
        "data": {"program": "anigen-prepare", "args": {"--procedural": 3}},
        "fit": {"program": "anigen-train", "config": "train.json", "args": {"--dataset": "{data}"}},
        "shapes": {"program": "anigen-encode", "output": "--output", "args": {"--dataset": "{data}"}},
        "rigs": {"program": "anigen-eval", "args": {"--pred": "a={fit}", "--dataset": "{shapes}"}}
      },
      "seeds": [0, 1], "seeded": ["fit"],
      "costs": [{"title": "Costs", "rows": [
        {"label": "shapes", "step": "shapes", "files": "*/mesh.glb"},
        {"label": "both", "step": "rigs", "files": "*.glb", "before": ["shapes"], "models": ["fit"]},
        {"label": "half", "step": "rigs", "files": "*.glb", "models": ["fit/decoder"]}]}],
      "claims": [)" +
           claims + "]}";
  }
  static std::string claim(const std::string& cost, const std::string& of, const std::string& over) {
    return R"({"claim": "It costs less", "source": "Table 3", "cost": ")" + cost + R"(", "of": ")" + of +
           R"(", "over": ")" + over + R"("})";
  }

  void done(const Job& job, double seconds, std::uint64_t bytes) {
    JobRecord record = read_record(place_.out, job.id).value();
    record.seconds = seconds;
    record.peak_bytes = bytes;
    write_record(place_.out, job.id, record);
  }

  // Two assets in each step: 8 s for both shapes, 4 and 6 s for both rigs of either seed, 60 and 120 s of training.
  Plan measured(const std::string& text) {
    const Plan all = plan(text);
    run_jobs(place_.out, all, {});
    for (std::size_t run = 0; run < 2; ++run) {
      const double seed = static_cast<double>(run);
      const Job &fit = job_of(all, run, "fit"), &rigs = job_of(all, run, "rigs"), &shapes = job_of(all, run, "shapes");
      done(fit, 60 + 60 * seed, 9'000'000'000);
      done(shapes, 8, 2'000'000'000);
      done(rigs, 4 + 2 * seed, 1'000'000'000 + 500'000'000 * run);
      write_file_atomically(fit.folder / "parameters.json", R"({"encoder": 1000000, "decoder": 3000000})");
      for (const char* name : {"a", "b"}) {
        write_file_atomically(shapes.folder / name / "mesh.glb", "");
        write_file_atomically(rigs.folder / (std::string(name) + ".glb"), "");
      }
    }
    return all;
  }
};

TEST_F(MethodCosts, AreTimesOfCallsPerAssetWithWhatComesBefore) {
  const std::string text = with_costs("");
  const Plan plan = measured(text);
  const std::vector<MethodCost> costs = method_costs(plan, place_.out, experiment(text).costs.front());
  ASSERT_EQ(costs.size(), 3u);
  EXPECT_EQ(costs[0].jobs, 1u);
  EXPECT_EQ(costs[0].assets, 2u);
  EXPECT_DOUBLE_EQ(costs[0].seconds, 4.0);
  EXPECT_EQ(costs[0].parameters, 0);
  const MethodCost& both = costs[1];
  EXPECT_EQ(both.jobs, 2u);
  EXPECT_DOUBLE_EQ(both.seconds, 2.5);
  EXPECT_DOUBLE_EQ(both.seconds_before, 4.0);
  EXPECT_EQ(both.by_job, (std::vector<double>{6.0, 7.0}));
  EXPECT_EQ(both.peak_bytes, 2'000'000'000u) << "of the shapes";
  EXPECT_EQ(both.parameters, 4'000'000);
  EXPECT_DOUBLE_EQ(both.training_seconds, 90.0);
  EXPECT_EQ(both.training_by_seed, (std::vector<double>{60.0, 120.0}));
  EXPECT_EQ(costs[2].parameters, 3'000'000);
  EXPECT_EQ(costs[2].peak_bytes, 1'500'000'000u);
  const Table table = method_cost_table(costs);
  EXPECT_EQ(table.rows[1][3], "6.50");
  EXPECT_EQ(table.rows[1][5], "4.00 M");
  EXPECT_EQ(table.rows[0][5], "none");
}

TEST_F(MethodCosts, CanBeClaimed) {
  const std::string text = with_costs(claim("parameters", "half", "both") + "," + claim("memory", "both", "shapes") +
                                      "," + claim("seconds", "shapes", "both") + "," +
                                      claim("training", "half", "both") + "," + claim("training", "shapes", "both"));
  const Plan plan = measured(text);
  const Experiment read = experiment(text);
  const std::vector<ClaimResult> claims = judge_claims(read, plan, place_.out);
  EXPECT_EQ(claims[0].verdict, Verdict::kConfirmed);
  EXPECT_DOUBLE_EQ(claims[0].of.mean, 3.0);
  EXPECT_EQ(claims[1].verdict, Verdict::kTooSmall) << "equal";
  // 2 and 3 s less: 2.5 ± 12.7 · 0.5.
  EXPECT_EQ(claims[2].verdict, Verdict::kTooSmall);
  EXPECT_NEAR(claims[2].seed_interval.low, 2.5 - 12.7062 * 0.5, 1e-3);
  EXPECT_EQ(claims[3].verdict, Verdict::kTooSmall) << "equal";
  EXPECT_EQ(claims[3].of.by_seed, (std::vector<double>{1.0, 2.0}));
  EXPECT_EQ(claims[4].by_seed, (std::vector<double>{1.0, 2.0})) << "no model against one and two minutes";
  EXPECT_EQ(claims[4].reason, "");
  const std::string report = read_file(write_report(read, plan, place_));
  EXPECT_NE(report.find("with what comes before"), std::string::npos);
  EXPECT_NE(read_file(place_.out / "results.json").find("training_seconds"), std::string::npos);
}

TEST_F(MethodCosts, OfJobsThatSharedCoresOtherwiseAreNotCompared) {
  const std::string text = with_costs(claim("seconds", "shapes", "both") + "," + claim("memory", "half", "both"));
  const Plan plan = measured(text);
  const Experiment read = experiment(text);
  JobRecord record = read_record(place_.out, job_of(plan, 0, "shapes").id).value();
  EXPECT_EQ(record.share.at_once, 1);
  EXPECT_GE(record.share.threads, 1);
  record.share = {record.share.threads + 1, 1};
  write_record(place_.out, job_of(plan, 0, "shapes").id, record);
  std::vector<ClaimResult> claims = judge_claims(read, plan, place_.out);
  EXPECT_EQ(claims[0].verdict, Verdict::kNotRun);
  EXPECT_NE(claims[0].reason.find("times are of"), std::string::npos) << claims[0].reason;
  EXPECT_EQ(claims[1].reason, "") << "memory";
  for (std::size_t run = 0; run < 2; ++run) {
    for (const char* step : {"shapes", "rigs"}) {
      record = read_record(place_.out, job_of(plan, run, step).id).value();
      record.share = {CoreShare::kChanged, CoreShare::kChanged};
      write_record(place_.out, job_of(plan, run, step).id, record);
    }
  }
  EXPECT_NE(judge_claims(read, plan, place_.out)[0].reason.find("several attempts"), std::string::npos);
}

TEST_F(MethodCosts, OfWhatHasNotRunAreUnknown) {
  const std::string text = with_costs(claim("seconds", "shapes", "both"));
  const Plan unrun = plan(text);
  const std::vector<MethodCost> costs = method_costs(unrun, place_.out, experiment(text).costs.front());
  EXPECT_EQ(method_cost_table(costs).rows[1][2], "–");
  EXPECT_EQ(judge_claims(experiment(text), unrun, place_.out)[0].verdict, Verdict::kNotRun);
  const Plan run = measured(text);
  const auto file = job_of(run, 0, "fit").folder / "parameters.json";
  std::filesystem::remove(file);
  EXPECT_EQ(method_costs(run, place_.out, experiment(text).costs.front())[1].parameters, -1);
  write_file_atomically(file, R"({"encoder": "many"})");
  EXPECT_THROW(method_costs(run, place_.out, experiment(text).costs.front()), InputError);
  write_file_atomically(file, R"({"encoder": 5})");
  EXPECT_THROW(method_costs(run, place_.out, experiment(text).costs.front()), InputError) << "no decoder";
}

TEST_F(MethodCosts, BadOnesNameTheKey) {
  const auto message = [&](const std::string& from, const std::string& to, const std::string& claims = "") {
    std::string text = with_costs(claims);
    if (!from.empty()) text.replace(text.find(from), from.size(), to);
    return error_of([&] { experiment(text); });
  };
  EXPECT_NE(message("\"*.glb\"", "\"mesh.glb\"").find("files"), std::string::npos);
  EXPECT_NE(message("\"models\": [\"fit\"]", "\"models\": [\"fits/decoder\"]").find("models"), std::string::npos);
  EXPECT_NE(message("[\"shapes\"]", "[\"shape\"]").find("before"), std::string::npos);
  EXPECT_NE(message("", "", claim("money", "half", "both")).find("cost"), std::string::npos);
  EXPECT_NE(message("", "", claim("seconds", "half", "nobody")).find("nobody"), std::string::npos);
  EXPECT_NE(message("", "", claim("seconds", "half", "half")).find("same"), std::string::npos);
}

}  // namespace
}  // namespace anigen::experiment
