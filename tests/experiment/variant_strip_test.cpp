#include "anigen/experiment/variant_strip.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/run_jobs.h"
#include "anigen/io/image.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

class VariantStrip : public ExperimentFolder {
 protected:
  static std::string with_strip(const std::string& rest) {
    std::string json = kTwoVariants;
    json.insert(json.rfind('}'), R"(, "strips": [{"title": "Side by side", "step": "fit")" + rest + "}]");
    return json;
  }
  static constexpr const char kRest[] = R"(, "files": "*/out.png", "panels": 3, "panel": 2, "first_panel": 1, "most": 2,
    "value": {"step": "score", "method": "ours", "column": {"key": "j2j", "label": "J2J", "digits": 1}})";
};

TEST_F(VariantStrip, ShowsTheSameAssetsUnderEveryVariant) {
  const Experiment e = experiment(with_strip(kRest));
  const Plan plan = make_plan(e, place_);
  EXPECT_TRUE(variant_strip(e, plan, place_.out, e.strips[0]).rows.empty()) << "nothing is done yet";
  run_jobs(place_.out, plan, {});
  for (std::size_t run = 0; run < plan.runs.size(); ++run) {
    if (plan.runs[run].seed != 0) continue;
    const std::filesystem::path fit = job_of(plan, run, "fit").folder;
    for (const char* asset : {"a", "b", "c", "d"}) {
      const bool missing = plan.runs[run].variant == 1 && asset[0] == 'c';
      if (!missing) io::write_png(fit / asset / "out.png", io::Image(30, 10, 0xFF0000FFu));
    }
    write_file_atomically(job_of(plan, run, "score").folder / "metrics.csv",
                          "id,method,failure,j2j\na,ours,,0.25\na,other,,7\nc,ours,no mesh,\n");
  }
  const Strip strip = variant_strip(e, plan, place_.out, e.strips[0]);
  EXPECT_EQ(strip.columns, (std::vector<std::string>{"plain", "fast"}));
  ASSERT_EQ(strip.rows.size(), 2u) << "evenly spaced: a and c of four";
  EXPECT_EQ(strip.rows[0].asset, "a");
  EXPECT_EQ(strip.rows[1].asset, "c");
  EXPECT_EQ(strip.rows[0].cells[0].value, "0.2");
  EXPECT_TRUE(strip.rows[1].cells[0].value.empty());
  EXPECT_FALSE(strip.rows[1].cells[0].file.empty());
  EXPECT_TRUE(strip.rows[1].cells[1].file.empty());

  const std::string html = report_html(e, plan, place_, collect_all_results(e, plan, place_));
  EXPECT_NE(html.find("Side by side"), std::string::npos);
  EXPECT_NE(html.find("J2J 0.2"), std::string::npos);
  EXPECT_NE(html.find("no file"), std::string::npos);
}

TEST_F(VariantStrip, PanelsAreWithinTheFile) {
  EXPECT_NE(error_of([&] { experiment(with_strip("")); }).find("files"), std::string::npos);
  EXPECT_NE(error_of([&] { experiment(with_strip(R"(, "files": "out.png")")); }).find("one * is needed"),
            std::string::npos);
  EXPECT_NE(error_of([&] {
              experiment(with_strip(R"(, "files": "*/out.png", "panels": 2, "panel": 3)"));
            }).find("/strips/0/panel"),
            std::string::npos);
  EXPECT_EQ(error_of([&] { experiment(with_strip(kRest)); }), "no error");
}

}  // namespace
}  // namespace anigen::experiment
