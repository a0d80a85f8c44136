#include <algorithm>

#include "anigen/core/json.h"
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
