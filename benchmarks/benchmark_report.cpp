// Puts what the benchmarks wrote into one JSON file and one Markdown table.
//   benchmark_report ALL.json ALL.md [--compare=OLD.json]... FILE.json...
// Each FILE is of --benchmark_out; rows that several have are turns, and the one of the median time counts. With
// --compare, a column says how many times as fast each row is as in results of before: the median over turns, the n-th
// of one beside the n-th of the other, with the least and the most where there are several. Rows that were slower in
// every turn by 3 % are listed. Figures of two runs that did not take turns show differences that are none, as machines
// wander.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"

namespace {

using anigen::Json;

std::string number(double value, int digits) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

double milliseconds(const Json& row) {
  const std::string unit = row.value("time_unit", "ms");
  const double factor = unit == "ns" ? 1e-6 : unit == "us" ? 1e-3 : unit == "s" ? 1e3 : 1.0;
  return factor * row.at("real_time").get<double>();
}

// Of the matrix product in the same type; benchmarks without one have none.
std::string share(const Json& row) {
  for (const char* key : {"share_of_product", "share_of_matrix_product"}) {
    if (row.contains(key)) return number(100.0 * row.at(key).get<double>(), 1) + " %";
  }
  return "";
}

// Single repetitions and their spread are left out where there is a median.
bool is_shown(const Json& row) {
  const bool repeated = row.value("repetitions", 1) > 1;
  return row.contains("real_time") && (!repeated || row.value("aggregate_name", "") == "median");
}

constexpr double kSlower = 0.97;  // times as fast as before, or less: the same program differs by as much

// Milliseconds of every row, a turn after the other.
using Times = std::map<std::string, std::vector<double>>;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : (values[middle - 1] + values[middle]) / 2.0;
}

std::vector<Json> shown_rows(const std::string& file) {
  const Json json = anigen::read_json(file);
  if (!json.is_object() || !json.contains("benchmarks"))
    throw anigen::InputError(file, "benchmarks", "not the JSON of a benchmark");
  std::vector<Json> rows;
  for (const Json& row : json.at("benchmarks")) {
    if (is_shown(row)) rows.push_back(row);
  }
  return rows;
}

// Of each name, in the order of their first turns, the row whose time is the median, or the upper one of two.
Json median_rows(const std::vector<Json>& rows) {
  std::vector<std::string> names;
  std::map<std::string, std::vector<Json>> turns;
  for (const Json& row : rows) {
    const std::string name = row.at("name").get<std::string>();
    if (turns[name].empty()) names.push_back(name);
    turns[name].push_back(row);
  }
  Json medians = Json::array();
  for (const std::string& name : names) {
    std::vector<Json>& list = turns[name];
    std::sort(list.begin(), list.end(), [](const Json& a, const Json& b) { return milliseconds(a) < milliseconds(b); });
    medians.push_back(list[list.size() / 2]);
  }
  return medians;
}

Times times_of(const std::vector<Json>& rows) {
  Times times;
  for (const Json& row : rows) times[row.at("name").get<std::string>()].push_back(milliseconds(row));
  return times;
}

// Time of before over the time now, turn by turn; empty for a row that is new.
std::vector<double> speedups(const std::vector<double>& now, const std::vector<double>& before) {
  std::vector<double> ratios;
  for (std::size_t i = 0; i < std::min(now.size(), before.size()); ++i) ratios.push_back(before[i] / now[i]);
  return ratios;
}

std::string speedup_text(const std::vector<double>& ratios) {
  if (ratios.empty()) return "";
  const std::string text = number(median(ratios), 2);
  if (ratios.size() == 1) return text;
  const auto [least, most] = std::minmax_element(ratios.begin(), ratios.end());
  return text + " (" + number(*least, 2) + " to " + number(*most, 2) + ")";
}

std::string table(const Json& rows, const Times& times, const Times& before) {
  std::string text = "| benchmark | ms | of the matrix product | peak GB |", slower;
  text += before.empty() ? "\n|---|--:|--:|--:|\n" : " times as fast as before |\n|---|--:|--:|--:|--:|\n";
  for (const Json& row : rows) {
    const std::string name = row.at("name").get<std::string>();
    const double now = median(times.at(name));
    text += "| " + name + " | " + number(now, now < 10.0 ? 3 : 1) + " | " + share(row) + " | " +
            (row.contains("peak_gigabytes") ? number(row.at("peak_gigabytes").get<double>(), 2) : "") + " |";
    if (!before.empty()) {
      const auto old = before.find(name);
      const std::vector<double> ratios =
          old == before.end() ? std::vector<double>() : speedups(times.at(name), old->second);
      text += " " + speedup_text(ratios) + " |";
      const bool in_every_turn = ratios.size() > 1 && *std::max_element(ratios.begin(), ratios.end()) < kSlower;
      if (in_every_turn) slower += "- " + name + ": " + speedup_text(ratios) + "\n";
    }
    text += "\n";
  }
  return slower.empty() ? text : text + "\nSlower in every turn, by 3 % and more:\n\n" + slower;
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string flag = "--compare=";
  std::vector<std::string> files, compared;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word.compare(0, flag.size(), flag) == 0) {
      compared.push_back(word.substr(flag.size()));
    } else {
      files.push_back(word);
    }
  }
  if (files.size() < 3) {
    std::fprintf(stderr, "usage: benchmark_report ALL.json ALL.md [--compare=OLD.json]... FILE.json...\n");
    return 2;
  }
  std::vector<Json> turns, before;
  for (std::size_t i = 2; i < files.size(); ++i) {
    for (const Json& row : shown_rows(files[i])) turns.push_back(row);
  }
  for (const std::string& file : compared) {
    for (const Json& row : shown_rows(file)) before.push_back(row);
  }
  const Json rows = median_rows(turns);
  const std::string text = table(rows, times_of(turns), times_of(before));
  anigen::write_file_atomically(files[0], Json{{"benchmarks", rows}}.dump(2) + "\n");
  anigen::write_file_atomically(files[1], text);
  std::printf("%s", text.c_str());
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
