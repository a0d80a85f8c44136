#include "anigen/experiment/file.h"

#include "anigen/experiment/plan.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

using ExperimentFile = ExperimentFolder;

TEST_F(ExperimentFile, StepsSeedsAndTablesAreRead) {
  const Experiment e = experiment(kTwoVariants);
  EXPECT_EQ(e.title, "Two variants");
  ASSERT_EQ(e.variants.size(), 2u);
  EXPECT_EQ(e.variants[1].name, "fast");
  EXPECT_EQ(e.seeds, (std::vector<std::uint64_t>{0, 1}));
  EXPECT_EQ(e.tables.at(0).columns.at(0).better, Column::Better::kLower);
  EXPECT_EQ(read_step(e, e.variants[0], "fit").settings, Json::object());
  EXPECT_EQ(read_step(e, e.variants[1], "fit").settings, Json({{"trainer.args.lr", 2}}));
  EXPECT_EQ(read_step(e, e.variants[0], "data").output, "--output");
  EXPECT_EQ(read_step(e, e.variants[0], "fit").output, "--output");
}

TEST_F(ExperimentFile, AGridIsMultipliedWithTheVariants) {
  const Experiment e = experiment(R"({"title": "g",
    "steps": {"fit": {"program": "anigen-train", "config": "train.json", "set": {"trainer.args.steps": 9}}},
    "variants": {"a": {}, "b": {"fit": {"set": {"x": 1}}}},
    "grid": [{"step": "fit", "set": "trainer.args.lr", "values": [1, 2, 3]},
             {"step": "fit", "set": "trainer.args.name", "label": "called", "values": ["p", "q"]}]})");
  ASSERT_EQ(e.variants.size(), 12u);
  EXPECT_EQ(e.variants[11].name, "b, lr=3, called=q");
  EXPECT_EQ(read_step(e, e.variants[11], "fit").settings,
            Json({{"trainer.args.steps", 9}, {"x", 1}, {"trainer.args.lr", 3}, {"trainer.args.name", "q"}}));
}

TEST_F(ExperimentFile, SettingsMayBeNestedAndTheLaterOfTwoCounts) {
  const Experiment e = experiment(R"({"title": "n",
    "steps": {"fit": {"program": "anigen-train", "config": "train.json",
      "set": {"trainer.args.lr": 2, "trainer": {"args": {"lr": 3, "list": [1]}}}}}})");
  EXPECT_EQ(read_step(e, e.variants[0], "fit").settings, Json({{"trainer.args.lr", 3}, {"trainer.args.list", {1}}}));
  const Experiment overridden =
      read_experiment(folder_ / "experiment.json", {"steps.fit.set.trainer.args.lr=9", "title=m"});
  const Experiment variant = experiment(R"({"title": "n",
    "steps": {"fit": {"program": "anigen-train", "config": "train.json",
      "set": {"trainer.args": {"steps": 1}, "trainer.args.lr": 1}}},
    "variants": {"v": {"fit": {"set": {"trainer.args": {"lr": 2}}}}}})");
  EXPECT_EQ(read_step(variant, variant.variants[0], "fit").settings,
            Json({{"trainer.args.steps", 1}, {"trainer.args.lr", 2}}));
  EXPECT_EQ(overridden.title, "m");
  EXPECT_EQ(read_step(overridden, e.variants[0], "fit").settings.at("trainer.args.lr"), 9);
}

TEST_F(ExperimentFile, ViewersNameStepsAndOneStarPerFile) {
  const auto with = [](const std::string& shown) {
    return R"({"title": "v", "steps": {"made": {"program": "anigen-prepare"}}, "viewers": [{"title": "t", "shown": )" +
           shown + "}]}";
  };
  const Experiment e = experiment(with(R"([{"step": "made", "files": "*/mesh.glb"}])"));
  EXPECT_EQ(e.viewers.at(0).shown.at(0).label, "made");
  EXPECT_EQ(e.viewers.at(0).most, 3u);
  for (const char* bad : {"[]", R"([{"step": "made", "files": "mesh.glb"}])",
                          R"([{"step": "made", "files": "*/*.glb"}])", R"([{"step": "mode", "files": "*.glb"}])"}) {
    EXPECT_NE(error_of([&] { experiment(with(bad)); }), "no error") << bad;
  }
}

TEST_F(ExperimentFile, ErrorsNameThePlaceAndTheNearestWord) {
  const auto error = [&](const std::string& json) { return error_of([&] { experiment(json); }); };
  const std::string step = R"("steps": {"data": {"program": "anigen-prepare"}})";
  EXPECT_NE(error(R"({"steps": {}})").find("title"), std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "steps": {}})").find("at least one"), std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "stepz": {}, )" + step + "}").find("did you mean 'steps'"), std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "steps": {"a b": {"program": "anigen-prepare"}}})").find("letters"),
            std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "steps": {"a": {"program": "rm"}}})").find("/steps/a"), std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "variants": {"v": {"dta": {}}}, )" + step + "}").find("did you mean 'data'"),
            std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "seeds": [1, 1], )" + step + "}").find("different"), std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "seeds": [1, 2], )" + step + "}").find("no step that takes them"),
            std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "steps": {"a": {"program": "anigen-prepare", "args": {"--output": "."}}}})")
                .find("set by the experiment itself"),
            std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "steps": {"a": {"program": "anigen-encode"}}})").find("writes_into"),
            std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "steps": {"a": {"program": "anigen-train"}}})").find("config"), std::string::npos);
  EXPECT_NE(error(R"({"title": "x", "tables": [{"title": "t", "step": "data", "columns": []}], )" + step + "}")
                .find("/tables/0"),
            std::string::npos);
}

}  // namespace
}  // namespace anigen::experiment
