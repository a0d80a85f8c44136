#include <gtest/gtest.h>

#include "anigen/core/files.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/run_jobs.h"
#include "anigen/experiment/sheets.h"
#include "anigen/io/image.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {

namespace {

class ContactSheet : public ExperimentFolder {
 protected:
  static std::string with_sheet() {
    std::string json = kTwoVariants;
    json.insert(json.rfind('}'), R"(, "sheets": [{"title": "All of them", "step": "score", "method": "ours",
      "order": {"key": "j2j", "label": "J2J", "better": "lower", "digits": 2}, "most": 5,
      "shown": [{"label": "picture", "step": "data", "files": "*/in.png"},
                {"label": "asset", "step": "fit", "files": "*/out.png"}]}])");
    return json;
  }
};

TEST_F(ContactSheet, RanksEveryAssetAndMarksBestMedianAndWorst) {
  const Experiment e = experiment(with_sheet());
  const Plan plan = make_plan(e, place_);
  EXPECT_TRUE(sheet_cells(plan, place_.out, plan.runs[0], e.sheets[0]).empty()) << "nothing is done yet";
  run_jobs(place_.out, plan, {});
  const Job& scores = job_of(plan, 0, "score");
  write_file_atomically(
      scores.folder / "metrics.csv",
      "id,method,failure,j2j\na,ours,,0.3\nb,ours,,0.1\nc,other,,0.0\nd,ours,no mesh,\ne,ours,,0.2\n");
  write_file_atomically(job_of(plan, 0, "data").folder / "b/in.png", "no picture");
  io::write_png(job_of(plan, 0, "fit").folder / "b/out.png", io::Image(40, 20, 0xFF0000FFu));

  const std::vector<SheetCell> cells = sheet_cells(plan, place_.out, plan.runs[0], e.sheets[0]);
  ASSERT_EQ(cells.size(), 4u);
  const char* ids[] = {"b", "e", "a", "d"};
  const char* marks[] = {"best", "median", "worst", ""};
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(cells[i].id, ids[i]);
    EXPECT_EQ(cells[i].mark, marks[i]);
    EXPECT_EQ(cells[i].place, i < 3 ? i + 1 : 0);
  }
  EXPECT_FALSE(cells[0].files[0].empty());
  EXPECT_FALSE(cells[0].files[1].empty());
  EXPECT_TRUE(cells[1].files[1].empty());

  const std::string html = report_html(e, plan, place_, collect_all_results(e, plan, place_), {});
  EXPECT_NE(html.find("All of them: plain, seed 0"), std::string::npos);
  EXPECT_NE(html.find("1 · 0.10 · <b>best</b>"), std::string::npos);
  EXPECT_NE(html.find("data:image/jpeg;base64,"), std::string::npos);
  EXPECT_NE(html.find("cannot be decoded"), std::string::npos) << "a damaged picture is named, not fatal";
}

TEST_F(ContactSheet, ThinsALongListEvenly) {
  Experiment e = experiment(with_sheet());
  const Plan plan = make_plan(e, place_);
  run_jobs(place_.out, plan, {});
  std::string csv = "id,method,failure,j2j\n";
  for (int i = 0; i < 100; ++i) csv += "a" + std::to_string(i) + ",ours,," + std::to_string(i) + "\n";
  write_file_atomically(job_of(plan, 0, "score").folder / "metrics.csv", csv);
  const std::vector<SheetCell> cells = sheet_cells(plan, place_.out, plan.runs[0], e.sheets[0]);
  std::vector<std::size_t> places;
  for (const SheetCell& cell : cells) places.push_back(cell.place);
  EXPECT_EQ(places, (std::vector<std::size_t>{1, 21, 41, 51, 61, 81, 100}));

  e.sheets[0].order.better = Column::Better::kHigher;
  EXPECT_EQ(sheet_cells(plan, place_.out, plan.runs[0], e.sheets[0]).front().id, "a99");
  e.sheets[0].method = "theirs";
  EXPECT_NE(error_of([&] { sheet_cells(plan, place_.out, plan.runs[0], e.sheets[0]); }).find("there are: ours"),
            std::string::npos);
  e.sheets[0].order.key = "none";
  EXPECT_THROW(sheet_cells(plan, place_.out, plan.runs[0], e.sheets[0]), InputError);
}

TEST_F(ContactSheet, ASheetNeedsAMethodAnOrderAndAStar) {
  const auto spec = [](const std::string& rest) {
    std::string json = kTwoVariants;
    json.insert(json.rfind('}'), ", \"sheets\": [{\"title\": \"t\", \"step\": \"score\"" + rest + "}]");
    return json;
  };
  EXPECT_NE(error_of([&] { experiment(spec("")); }).find("method"), std::string::npos);
  const std::string start = R"(, "method": "ours", "order": "j2j", "shown": [{"step": "fit", "files": )";
  EXPECT_NE(error_of([&] { experiment(spec(start + "\"out.png\"}]")); }).find("one * is needed"), std::string::npos);
  EXPECT_EQ(error_of([&] { experiment(spec(start + "\"*/out.png\"}]")); }), "no error");
}

}  // namespace

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

  const std::string html = report_html(e, plan, place_, collect_all_results(e, plan, place_), {});
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
