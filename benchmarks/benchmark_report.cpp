// Puts what the benchmarks wrote into one JSON file and one Markdown table.
//   benchmark_report ALL.json ALL.md [--compare=OLD.json] FILE.json...
// Each FILE is of --benchmark_out. With --compare, a column says how many times as fast each row is as in an ALL.json
// of before: figures of two runs, so machines whose speed wanders show differences that are none.
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

std::map<std::string, double> times_of(const Json& all) {
  std::map<std::string, double> times;
  for (const Json& row : all.at("benchmarks")) times[row.at("name").get<std::string>()] = milliseconds(row);
  return times;
}

std::string table(const Json& all, const std::map<std::string, double>& before) {
  std::string text = "| benchmark | ms | of the matrix product | peak GB |";
  text += before.empty() ? "\n|---|--:|--:|--:|\n" : " times as fast as before |\n|---|--:|--:|--:|--:|\n";
  for (const Json& row : all.at("benchmarks")) {
    const std::string name = row.at("name").get<std::string>();
    const double now = milliseconds(row);
    text += "| " + name + " | " + number(now, now < 10.0 ? 3 : 1) + " | " + share(row) + " | " +
            (row.contains("peak_gigabytes") ? number(row.at("peak_gigabytes").get<double>(), 2) : "") + " |";
    const auto old = before.find(name);
    if (!before.empty()) text += (old == before.end() ? " " : " " + number(old->second / now, 2)) + " |";
    text += "\n";
  }
  return text;
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string flag = "--compare=";
  std::vector<std::string> files;
  std::string compared;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word.compare(0, flag.size(), flag) == 0) {
      compared = word.substr(flag.size());
    } else {
      files.push_back(word);
    }
  }
  if (files.size() < 3) {
    std::fprintf(stderr, "usage: benchmark_report ALL.json ALL.md [--compare=OLD.json] FILE.json...\n");
    return 2;
  }
  Json all = {{"benchmarks", Json::array()}};
  for (std::size_t i = 2; i < files.size(); ++i) {
    const Json json = anigen::read_json(files[i]);
    if (!json.is_object() || !json.contains("benchmarks"))
      throw anigen::InputError(files[i], "benchmarks", "not the JSON of a benchmark");
    for (const Json& row : json.at("benchmarks")) {
      if (is_shown(row)) all["benchmarks"].push_back(row);
    }
  }
  const std::map<std::string, double> before =
      compared.empty() ? std::map<std::string, double>() : times_of(anigen::read_json(compared));
  const std::string text = table(all, before);
  anigen::write_file_atomically(files[0], all.dump(2) + "\n");
  anigen::write_file_atomically(files[1], text);
  std::printf("%s", text.c_str());
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
