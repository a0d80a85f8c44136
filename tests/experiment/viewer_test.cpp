#include <gtest/gtest.h>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/sheets.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

class ExperimentViewer : public ExperimentFolder {
 protected:
  /// A package that has the files of three.js, but says hardly anything.
  void install_three(const fs::path& modules) {
    const fs::path three = modules / "three";
    write_file_atomically(three / "package.json", "{}");
    write_file_atomically(three / "build/three.module.min.js", "import{a}from\"./three.core.min.js\";");
    write_file_atomically(three / "build/three.core.min.js", "export const a=1;");
    write_file_atomically(three / "examples/jsm/loaders/GLTFLoader.js",
                          "import { b } from '../utils/BufferGeometryUtils.js';");
    write_file_atomically(three / "examples/jsm/controls/OrbitControls.js", "import { c } from 'three';");
    write_file_atomically(three / "examples/jsm/utils/BufferGeometryUtils.js", "export const b = 2;");
  }

  static std::string with_viewer() {
    std::string json = kTwoVariants;
    json.insert(json.rfind('}'), R"(, "viewers": [{"title": "In 3D", "most": 2, "shown": [
      {"label": "made", "step": "fit", "files": "*/mesh.glb"}, {"label": "truth", "step": "data", "files": "a/*.glb"}]}])");
    return json;
  }
};

TEST_F(ExperimentViewer, AnAssetIsShownAsEveryVariantAndTheTruthHaveIt) {
  const Experiment e = experiment(with_viewer());
  const Plan plan = make_plan(e, place_);
  EXPECT_TRUE(viewed_assets(e, plan, e.viewers[0]).empty()) << "nothing is done yet";
  for (const char* name : {"cat", "cow", "dog"}) {
    write_file_atomically(job_of(plan, 0, "fit").folder / name / "mesh.glb", "one");
    write_file_atomically(job_of(plan, 0, "data").folder / "a" / (std::string(name) + ".glb"), "three");
  }
  write_file_atomically(job_of(plan, 2, "fit").folder / "cat/mesh.glb", "two");
  const std::vector<ViewedAsset> assets = viewed_assets(e, plan, e.viewers[0]);
  ASSERT_EQ(assets.size(), 2u) << "as many as \"most\" says";
  EXPECT_EQ(assets[0].name, "cat");
  ASSERT_EQ(assets[0].shown.size(), 3u);
  EXPECT_EQ(assets[0].shown[0].label, "made, plain");
  EXPECT_EQ(assets[0].shown[1].label, "made, fast");
  EXPECT_EQ(assets[0].shown[2].label, "truth");
  EXPECT_EQ(assets[1].shown.size(), 2u) << "the second variant has no cow";
  const std::string html = viewer_html(assets, "a<b", 1);
  EXPECT_NE(html.find("a&lt;b"), std::string::npos);
  EXPECT_NE(html.find("id=\"glb-1-0-1\">" + base64(std::string_view("two"))), std::string::npos);
  EXPECT_EQ(viewer_html({}, "none", 1), "");
}

TEST_F(ExperimentViewer, ThreeIsFoundAboveAndItsModulesNameEachOther) {
  const fs::path below = folder_ / "project/experiments";
  fs::create_directories(below);
  install_three(folder_ / "project/.cache/node/node_modules");
  const fs::path three = find_three(below);
  ASSERT_FALSE(three.empty());
  const Json imports = Json::parse(three_import_map(three)).at("imports");
  const std::string prefix = "data:text/javascript;base64,";
  EXPECT_EQ(imports.at("three"), prefix + base64(std::string_view("import{a}from\"three/core\";")));
  EXPECT_EQ(imports.at("three/addons/GLTFLoader.js"),
            prefix + base64(std::string_view("import { b } from 'three/addons/BufferGeometryUtils.js';")));
  fs::remove(three / "examples/jsm/loaders/GLTFLoader.js");
  EXPECT_NE(error_of([&] { three_import_map(three); }).find("GLTFLoader.js"), std::string::npos);
}

TEST_F(ExperimentViewer, AReportHoldsTheViewsAndTheScriptOnce) {
  install_three(folder_ / "node_modules");
  const Experiment e = experiment(with_viewer());
  const Plan plan = make_plan(e, place_);
  const auto count = [&](const std::string& text) {
    const std::string html = report_html(e, plan, place_, {}, {});
    std::size_t found = 0;
    for (std::size_t at = html.find(text); at != std::string::npos; at = html.find(text, at + 1)) ++found;
    return found;
  };
  EXPECT_EQ(count("importmap"), 0u) << "there is nothing to see";
  write_file_atomically(job_of(plan, 0, "fit").folder / "cat/mesh.glb", "one");
  EXPECT_EQ(count("<script type=\"importmap\">"), 1u);
  EXPECT_EQ(count("id=\"viewer-"), 1u);
}

}  // namespace
}  // namespace anigen::experiment
