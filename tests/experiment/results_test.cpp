#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/table.h"
#include "anigen/experiment/report.h"
#include "anigen/experiment/results.h"
#include "anigen/experiment/run_jobs.h"
#include "tests/experiment/experiment_folder.h"
#include "tests/support/paths.h"

// The tables of the documentation against the raw results in experiments/results, whose README.md has the rules.

namespace anigen::experiment {

namespace {

TEST(Statistics, StudentsIntervalOfKnownValues) {
  const eval::Interval three = student_interval({1, 2, 3});  // 2 ± 4.3027 · 1 / √3
  EXPECT_NEAR(three.high - 2, 4.3027 / std::sqrt(3.0), 1e-3);
  EXPECT_NEAR(2 - three.low, 4.3027 / std::sqrt(3.0), 1e-3);
  std::vector<double> many;
  for (int i = 0; i < 31; ++i) many.push_back(i % 2);
  const double mean = 15.0 / 31, deviation = std::sqrt(31 * mean * (1 - mean) / 30);
  EXPECT_NEAR(student_interval(many).high - mean, 2.0423 * deviation / std::sqrt(31.0), 1e-4);  // 30 degrees
  EXPECT_EQ(student_interval({5}).low, 5);
}

TEST(Statistics, SignFlipsKnowAConstantDifferenceFromNone) {
  EXPECT_TRUE(std::isnan(sign_flip_p({1, 1, 1, 1, 1}, "few")));
  // All ten of one sign: 2 of 1,024 choices are as far.
  EXPECT_NEAR(sign_flip_p(std::vector<double>(10, 0.3), "all"), 2.0 / 1024, 1.5e-3);
  EXPECT_NEAR(sign_flip_p({1, -1, 2, -2, 3, -3, 1, -1}, "none"), 1.0, 1e-9);
}

class ExperimentResults : public ExperimentFolder {
 protected:
  ExperimentResults() : experiment_(experiment(kTwoVariants)), plan_(make_plan(experiment_, place_)) {
    log::setup("off");
  }
  void scores(std::size_t run, const std::vector<std::string>& values) {
    std::string text = "id,method,failure,j2j\n";
    for (std::size_t i = 0; i < values.size(); ++i)
      text += "asset" + std::to_string(i) + ",ours," + (values[i].empty() ? "broken" : "") + "," + values[i] + "\n";
    write_file_atomically(job_of(plan_, run, "score").folder / "metrics.csv", text);
  }
  ResultTable table() { return collect_results(experiment_, plan_, place_.out, experiment_.tables[0]); }

  Experiment experiment_;
  Plan plan_;
};

TEST_F(ExperimentResults, MeansOverSeedsDifferencesOverAssets) {
  run_jobs(place_.out, plan_, {});
  scores(0, {"1", "2", "3", "4", "5", "6"});
  scores(1, {"3", "4", "5", "6", "7", "8"});
  scores(2, {"1", "2", "3", "4", "5", "6"});
  scores(3, {"2", "3", "4", "5", "6", ""});
  const ResultTable result = table();
  ASSERT_EQ(result.rows.size(), 2u);
  const Row &plain = result.rows[0], &fast = result.rows[1];
  EXPECT_EQ(plain.cells[0].by_seed, (std::vector<double>{3.5, 5.5}));
  EXPECT_DOUBLE_EQ(plain.cells[0].mean, 4.5);
  EXPECT_NEAR(plain.cells[0].interval.high - 4.5, 12.7062, 1e-3);  // √2 / √2 · t of one degree
  EXPECT_DOUBLE_EQ(plain.cells[0].by_asset.at("asset0"), 2);
  EXPECT_EQ(fast.assets, 12u);
  EXPECT_EQ(fast.failed, 1u);
  EXPECT_EQ(fast.cells[0].by_seed, (std::vector<double>{3.5, 4}));
  ASSERT_EQ(result.differences.size(), 1u);
  EXPECT_EQ(result.differences[0].columns[0].n, 6u);
  // The last asset has both values in the first seed alone, where both are 6.
  EXPECT_NEAR(result.differences[0].columns[0].mean, 5 * -0.5 / 6, 1e-12);
  // Without a value for the hardest asset in one seed there is no place for it.
  EXPECT_EQ(to_markdown(mean_table(result)).find("**"), std::string::npos);
  scores(3, {"2", "3", "4", "5", "6", "7"});
  const ResultTable whole = table();
  EXPECT_NE(to_markdown(mean_table(whole)).find("**4.0000"), std::string::npos);
  EXPECT_NE(to_latex(mean_table(whole)).find("\\textbf{4.0000 $\\pm$"), std::string::npos);
}

// An asset that one side fails on in a seed is compared in the other seeds alone: an easy seed of one side is not set
// against a hard one of the other.
TEST(PairedCells, CompareAnAssetInTheSeedsThatBothHave) {
  Cell of, over;
  of.seed_assets = {{{"a", 1.0}, {"b", 0.50}}, {{"a", 1.0}}, {{"a", 1.0}}};
  over.seed_assets = {{{"a", 1.1}, {"b", 0.47}}, {{"a", 1.04}, {"b", 0.90}}, {{"a", 1.04}, {"b", 0.90}}};
  const PairedCells pairs = paired(of, over);
  ASSERT_EQ(pairs.first.size(), 2U);
  EXPECT_NEAR(pairs.first[1] - pairs.second[1], 0.03, 1e-12);
  ASSERT_EQ(pairs.by_seed.size(), 3U);
  EXPECT_NEAR(pairs.by_seed[0], 0.5 * (-0.1 + 0.03), 1e-12);
  EXPECT_NEAR(pairs.by_seed[2], -0.04, 1e-12);
  EXPECT_NEAR(pairs.first_mean, (0.75 + 1.0 + 1.0) / 3, 1e-12);
  EXPECT_EQ(pairs.assets, 2U);
  // A seed without anything in common says nothing, and neither do seeds that have another place.
  of.seed_assets[1] = {};
  EXPECT_TRUE(paired(of, over).by_seed.empty());
  of.seed_assets.resize(2);
  EXPECT_TRUE(paired(of, over).first.empty());
  of.seed_assets.resize(1);  // a side that no seed changes
  EXPECT_EQ(paired(of, over).by_seed.size(), 3U);
}

// A run that both seeds share counts once: its interval is over the assets, and not without width.
TEST_F(ExperimentResults, ARowThatNoSeedChangesHasItsAssetsInterval) {
  run_jobs(place_.out, plan_, {});
  for (const std::size_t run : {0, 1, 2, 3}) scores(run, {"1", "2", "3", "4", "5", "6"});
  const Cell cell = table().rows[0].cells[0];
  EXPECT_EQ(cell.by_seed, std::vector<double>{3.5});
  EXPECT_LT(cell.interval.low, 3.0);
  EXPECT_GT(cell.interval.high, 4.0);
  // Likewise while the second seed has no value yet.
  scores(1, {"", "", "", "", "", ""});
  EXPECT_EQ(table().rows[0].cells[0].by_seed, std::vector<double>{3.5});
}

TEST_F(ExperimentResults, WhatIsMissingIsNamed) {
  run_jobs(place_.out, plan_, {1, 0, "data"});
  EXPECT_EQ(table().missing.size(), 4u);
  EXPECT_TRUE(table().rows.empty());
}

TEST_F(ExperimentResults, AFileWithoutTheColumnIsAnError) {
  run_jobs(place_.out, plan_, {});
  write_file_atomically(job_of(plan_, 0, "score").folder / "metrics.csv", "id,method\n1,ours\n");
  EXPECT_NE(error_of([&] { table(); }).find("has no column 'j2j'"), std::string::npos);
}

TEST_F(ExperimentResults, TheReportIsOneFileAndNamesItsSources) {
  run_jobs(place_.out, plan_, {});
  const std::string html = read_file(write_report(experiment_, plan_, place_));
  for (const char* part : {"Two variants", "<svg", "fast, seed 1", "SHA-256", "anigen-train", "Scores"})
    EXPECT_NE(html.find(part), std::string::npos) << part;
  EXPECT_EQ(html.find("src=\"http"), std::string::npos);
  for (const char* file : {"report.md", "1.tex", "results.json"}) EXPECT_FALSE(read_file(place_.out / file).empty());
}

TEST_F(ExperimentResults, ValuesThatDifferByRoundingReadEqual) {
  run_jobs(place_.out, plan_, {});
  for (const std::size_t run : {0, 1}) scores(run, {"0.1", "0.2", "0.3", "0.4", "0.5", "0.6"});
  for (const std::size_t run : {2, 3})
    scores(run, {"0.10000000000000002", "0.20000000000000004", "0.30000000000000004", "0.40000000000000008",
                 "0.50000000000000011", "0.60000000000000009"});
  const ResultTable result = table();
  EXPECT_EQ(difference_table(result).rows.at(0).back(), "equal");
  EXPECT_DOUBLE_EQ(result.differences[0].p[0], 1.0);
  const Table means = mean_table(result);
  for (const auto& row : means.rows) EXPECT_EQ(row.back().rfind("**", 0), 0u) << row.back();
}

}  // namespace

namespace {

namespace fs = std::filesystem;

struct MarkdownTable {
  std::size_t line = 0;  ///< of its header, from 1
  std::string marker;    ///< the text of an HTML comment on the last line before it that is not blank
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;
};

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r");
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// The text of a cell without blanks at its ends and without the underscores of the second best value, "_0.94 ± 0.07_".
std::string plain_cell(const std::string& cell) {
  const std::string text = trimmed(cell);
  return text.size() > 2 && text.front() == '_' && text.back() == '_' ? text.substr(1, text.size() - 2) : text;
}

// The cells of "| a | **b** | _c_ |" without bold face and italics.
std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells(1);
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line.compare(i, 2, "\\|") == 0 || line.compare(i, 2, "**") == 0) {
      if (line[i] == '\\') cells.back() += '|';
      ++i;
    } else if (line[i] == '|') {
      cells.emplace_back();
    } else {
      cells.back() += line[i];
    }
  }
  cells.erase(cells.begin());
  if (!cells.empty()) cells.pop_back();
  for (std::string& cell : cells) cell = plain_cell(cell);
  return cells;
}

std::vector<MarkdownTable> tables_of(const std::string& text) {
  static const std::regex delimiter(R"(^\|[ :|-]*-[ :|-]*\|$)"), comment(R"(^<!--\s*(.*?)\s*-->$)");
  std::vector<std::string> lines;
  std::istringstream stream(text);
  bool code = false;
  for (std::string line; std::getline(stream, line);) {
    line = trimmed(line);
    const bool fence = line.compare(0, 3, "```") == 0;
    if (fence) code = !code;
    lines.push_back(code || fence ? "code" : line);
  }
  std::vector<MarkdownTable> tables;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    if (!std::regex_match(lines[i], delimiter) || lines[i - 1].empty() || lines[i - 1][0] != '|') continue;
    MarkdownTable table;
    table.line = i;
    table.header = cells_of(lines[i - 1]);
    std::size_t before = i - 1;
    while (before > 0 && lines[before - 1].empty()) --before;
    std::smatch match;
    if (before > 0 && std::regex_match(lines[before - 1], match, comment)) table.marker = match[1];
    while (i + 1 < lines.size() && !lines[i + 1].empty() && lines[i + 1][0] == '|')
      table.rows.push_back(cells_of(lines[++i]));
    tables.push_back(std::move(table));
  }
  return tables;
}

// A number with decimals, an exponent, or a unit of time, size, speed or share, anywhere in a cell.
bool is_measure(const std::string& cell) {
  static const std::regex decimals(R"((^|.*[^0-9A-Za-z.])[0-9]+(\.[0-9]+|e[-−+]?[0-9]+)([^0-9.].*)?$)"),
      unit(R"(.*[0-9]\s*(%|s|ms|µs|min|h|MB|GB|MiB|GiB|GFLOP/s|TFLOP|times)([ ,;.:)].*)?$)");
  return std::regex_match(cell, decimals) || std::regex_match(cell, unit);
}

bool is_number(const std::string& cell) {
  static const std::regex first(R"(^(\+|-|−|±|<|>|~)?\s*[0-9].*)");
  return std::regex_match(cell, first) || is_measure(cell);
}

// True if most filled cells behind the first column are numbers, or at least two and half of those of one column are
// measures.
bool is_measured(const MarkdownTable& table) {
  std::size_t filled = 0, numbers = 0;
  for (std::size_t c = 1; c < table.header.size(); ++c) {
    std::size_t in_column = 0, measures = 0;
    for (const auto& row : table.rows) {
      if (c >= row.size() || row[c].empty()) continue;
      ++in_column;
      numbers += is_number(row[c]) ? 1 : 0;
      measures += is_measure(row[c]) ? 1 : 0;
    }
    filled += in_column;
    if (measures >= 2 && 2 * measures >= in_column) return true;
  }
  return 2 * numbers > filled;
}

// The first row of `shown` that is no row of `kept` in the columns that `shown` names; empty when there is none.
std::string strange_row(const MarkdownTable& shown, const MarkdownTable& kept) {
  std::vector<std::size_t> columns;
  for (const std::string& name : shown.header) {
    const auto found = std::find(kept.header.begin(), kept.header.end(), name);
    if (found == kept.header.end()) return "column '" + name + "'";
    columns.push_back(static_cast<std::size_t>(found - kept.header.begin()));
  }
  for (const auto& row : shown.rows) {
    const bool there = row.size() == columns.size() &&
                       std::any_of(kept.rows.begin(), kept.rows.end(), [&](const std::vector<std::string>& other) {
                         for (std::size_t c = 0; c < columns.size(); ++c)
                           if (columns[c] >= other.size() || other[columns[c]] != row[c]) return false;
                         return true;
                       });
    if (there) continue;
    std::string text = "row";
    for (const std::string& cell : row) text += " | " + cell;
    return text;
  }
  return "";
}

// Problems of the tables of a page: "page.md:12: …", a line each.
std::string problems_of_page(const std::string& page, const std::string& text, const fs::path& results) {
  std::string problems;
  for (const MarkdownTable& table : tables_of(text)) {
    const std::string place = page + ":" + std::to_string(table.line) + ": ";
    if (table.marker.compare(0, 8, "results:") != 0) {
      if (table.marker != "facts" && is_measured(table))
        problems += place + "a table of numbers without <!-- results: … --> or <!-- facts --> before it\n";
      continue;
    }
    const fs::path source = results / trimmed(table.marker.substr(8));
    if (!fs::is_regular_file(source)) {
      problems += place + source.string() + " is not there\n";
      continue;
    }
    std::string problem = "it has no table";
    for (const MarkdownTable& kept : tables_of(read_file(source))) {
      problem = strange_row(table, kept);
      if (problem.empty()) break;
    }
    if (!problem.empty()) problems += place + "not in " + source.filename().string() + ": " + problem + "\n";
  }
  return problems;
}

// Tables of a kept file that say <!-- means of FILE.csv: key, key --> hold, per value of the column "method", the means
// of those columns, rounded as they stand there.
std::string problems_of_kept_file(const fs::path& file) {
  static const std::regex means(R"(^means of (\S+): (.*)$)");
  std::string problems;
  for (const MarkdownTable& table : tables_of(read_file(file))) {
    const std::string place = file.filename().string() + ":" + std::to_string(table.line) + ": ";
    std::smatch match;
    if (!std::regex_match(table.marker, match, means)) continue;
    const CsvTable raw = read_csv(file.parent_path() / match[1].str());
    std::vector<std::string> keys;
    std::istringstream list(match[2]);
    for (std::string key; std::getline(list, key, ',');) keys.push_back(trimmed(key));
    for (const auto& row : table.rows) {
      for (std::size_t c = 0; c < keys.size(); ++c) {
        double sum = 0;
        int count = 0;
        for (std::size_t r = 0; r < raw.rows.size(); ++r) {
          if (raw.cell(r, "method") != row[0] || raw.cell(r, keys[c]).empty()) continue;
          sum += std::stod(raw.cell(r, keys[c]));
          ++count;
        }
        const std::string& cell = row.at(c + 1);
        const auto point = cell.find('.');
        const int digits = point == std::string::npos ? 0 : static_cast<int>(cell.size() - point - 1);
        if (count == 0 ? !cell.empty() : std::abs(std::stod(cell) - sum / count) > 0.500001 * std::pow(10.0, -digits))
          problems += place + row[0] + ", " + keys[c] + ": " + cell + " instead of " +
                      (count == 0 ? "nothing" : std::to_string(sum / count)) + "\n";
      }
    }
  }
  return problems;
}

std::vector<fs::path> pages() {
  std::vector<fs::path> files{test::source_dir() / "README.md"};
  for (const char* folder : {"docs", "datasets", "datasets/rig_benchmark"})
    for (const auto& entry : fs::directory_iterator(test::source_dir() / folder))
      if (entry.path().extension() == ".md") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<fs::path> kept_folders() {
  std::vector<fs::path> folders;
  for (const auto& entry : fs::directory_iterator(test::source_dir() / "experiments/results"))
    if (entry.is_directory()) folders.push_back(entry.path());
  std::sort(folders.begin(), folders.end());
  return folders;
}

constexpr const char* kKept =
    "| method | l1 | KL |\n|---|---:|---:|\n| heat | 0.829 | _2.36_ |\n| nearest | 0.961 | 8.59 |\n"
    "| voxels | 0.9 ± 0.1 | _3.1 ± 0.2_ |\n";

class KeptTables : public ::testing::Test {
 protected:
  std::string problems(const std::string& page) {
    write_file_atomically(folder_ / "table.md", kKept);
    return problems_of_page("page.md", page, folder_.path());
  }
  test::TemporaryFolder folder_;
};

TEST_F(KeptTables, ShowThemselvesOrAPart) {
  EXPECT_EQ(problems("<!-- results: table.md -->\n\n" + std::string(kKept)), "");
  EXPECT_EQ(problems("<!-- results: table.md -->\n| method | KL |\n|--|--|\n| nearest | **8.59** |\n"), "");
  EXPECT_EQ(problems("<!-- results: table.md -->\n| method | KL |\n|--|--|\n| heat | 2.36 |\n| voxels | 3.1 ± 0.2 |\n"),
            "");
}

TEST_F(KeptTables, AnotherNumberRowOrColumnIsFound) {
  const auto has = [&](const std::string& page, const char* words) {
    EXPECT_NE(problems(page).find(words), std::string::npos) << problems(page);
  };
  const std::string marker = "<!-- results: table.md -->\n";
  has(marker + "| method | l1 |\n|--|--|\n| heat | 0.828 |\n", "page.md:2: not in table.md: row | heat | 0.828");
  has(marker + "| method | l1 |\n|--|--|\n| nearest | 0.829 |\n", "row | nearest");
  has(marker + "| method | l1 |\n|--|--|\n| voxels | 0.9 ± 0.2 |\n", "row | voxels | 0.9 ± 0.2");
  has(marker + "| method | l2 |\n|--|--|\n| heat | 0.829 |\n", "column 'l2'");
  has("<!-- results: other.md -->\n" + std::string(kKept), "other.md is not there");
}

TEST_F(KeptTables, ATableOfNumbersNeedsASource) {
  EXPECT_NE(problems("Text.\n\n" + std::string(kKept)).find("page.md:3: a table of numbers"), std::string::npos);
  EXPECT_NE(problems("| what | figure |\n|--|--|\n| a pair | median 37 ms, largest 64 ms |\n"), "");
  EXPECT_NE(problems("| model | held out |\n|--|--|\n| joints | CD 0.110, EMD 0.140 |\n"), "");
  EXPECT_EQ(problems("<!-- facts -->\n| option | default |\n|--|--|\n| steps | 25 |\n"), "");
  EXPECT_EQ(problems("| option | default | meaning |\n|--|--|--|\n| steps | 25 | of the sampler |\n"), "");
  EXPECT_NE(problems("| part | agrees | error |\n|--|--|--|\n| a | all | 1e-7 |\n| b | all | 2e-6 |\n"), "");
  EXPECT_EQ(problems("```\n| a | b |\n|--|--|\n| c | 25 |\n```\n"), "");
}

TEST_F(KeptTables, MeansAreThoseOfTheRawFile) {
  write_file_atomically(folder_ / "metrics.csv",
                        "id,method,skin_l1\na,heat,0.5\nb,heat,0.76\nc,heat,\na,nearest,0.9\n");
  const auto of = [&](const std::string& cells) {
    write_file_atomically(folder_ / "table.md",
                          "<!-- means of metrics.csv: skin_l1 -->\n| method | l1 |\n|--|--|\n" + cells);
    return problems_of_kept_file(folder_ / "table.md");
  };
  EXPECT_EQ(of("| heat | 0.63 |\n| nearest | 0.900 |\n"), "");
  EXPECT_NE(of("| heat | 0.64 |\n"), "");
  EXPECT_NE(of("| cold | 0.64 |\n"), "");
}

TEST(Documentation, TablesAreThoseOfTheKeptResults) {
  std::size_t shown = 0;
  std::string problems;
  for (const fs::path& page : pages()) {
    const std::string text = read_file(page);
    problems += problems_of_page(fs::relative(page, test::source_dir()).string(), text,
                                 test::source_dir() / "experiments/results");
    for (const MarkdownTable& table : tables_of(text)) shown += table.marker.compare(0, 8, "results:") == 0 ? 1 : 0;
  }
  EXPECT_TRUE(problems.empty()) << problems;
  EXPECT_GE(shown, 1u);
}

TEST(Documentation, KeptResultsHaveTheirCommandAndRawFiles) {
  ASSERT_FALSE(kept_folders().empty());
  for (const fs::path& folder : kept_folders()) {
    SCOPED_TRACE(folder.filename());
    EXPECT_TRUE(fs::is_regular_file(folder / "command.txt") && fs::file_size(folder / "command.txt") > 0);
    std::uintmax_t bytes = 0;
    std::size_t raw = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (!entry.is_regular_file()) continue;
      bytes += entry.file_size();
      const std::string name = entry.path().filename().string(), extension = entry.path().extension().string();
      if (extension == ".md") {
        EXPECT_EQ(problems_of_kept_file(entry.path()), "");
      }
      if (name != "command.txt" && name != "table.md") ++raw;
    }
    EXPECT_GE(raw, 1u) << "no raw file beside the tables";
    EXPECT_LE(bytes, std::uintmax_t{1} << 20);
  }
}

// docs/architecture.md begins with a table from the paper to the code: | section | idea | `file` | `name` |.
TEST(Documentation, TheTableFromThePaperNamesWhatTheSourcesHold) {
  const std::string page = read_file(test::source_dir() / "docs/architecture.md");
  const std::regex row("\\| [0-9.]+ \\|[^|]*\\| `([a-z0-9_/]+\\.h)` \\| `(\\w+)` \\|");
  std::size_t rows = 0;
  for (std::sregex_iterator found(page.begin(), page.end(), row), end; found != end; ++found, ++rows) {
    const fs::path header = test::source_dir() / "anigen" / (*found)[1].str();
    ASSERT_TRUE(fs::is_regular_file(header)) << header;
    EXPECT_TRUE(std::regex_search(read_file(header), std::regex("\\b" + (*found)[2].str()))) << header << (*found)[2];
  }
  EXPECT_GE(rows, 20u);
}

}  // namespace

}  // namespace anigen::experiment
