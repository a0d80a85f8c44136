#include <algorithm>

#include "anigen/experiment/plan.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> shipped() {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(test::source_dir() / "experiments"))
    if (entry.path().extension() == ".json") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

class ShippedExperiments : public ExperimentFolder {};

TEST_F(ShippedExperiments, AreReadAndPlanned) {
  for (const char* name : {"anigen-generate", "anigen-rig"}) program(name, "#!/bin/bash\n");
  ASSERT_GE(shipped().size(), 5u);
  for (const fs::path& file : shipped()) {
    SCOPED_TRACE(file.filename());
    const Experiment e = read_experiment(file);
    const Plan p = make_plan(e, place_);
    EXPECT_EQ(p.runs.size(), e.variants.size() * e.seeds.size());
    EXPECT_FALSE(e.purpose.empty());
    EXPECT_FALSE(e.tables.empty());
    // Variants of an ablation share what lies before the ablated stage.
    if (e.variants.size() > 1) {
      EXPECT_EQ(job_of(p, 0, "dataset").serves.size(), p.runs.size());
    }
  }
}

TEST_F(ShippedExperiments, AnAblationRunsOnlyWhatItsTableNeeds) {
  const Plan p = make_plan(read_experiment(test::source_dir() / "experiments/ablation_adapters.json"), place_);
  // Dataset, auto-encoder and latents once; flow and evaluation for three variants with three seeds.
  EXPECT_EQ(p.jobs.size(), 3u + 9u * 2u);
}

}  // namespace
}  // namespace anigen::experiment
