#pragma once
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include "anigen/core/error.h"
#include "anigen/experiment/plan.h"
#include "tests/support/paths.h"

namespace anigen::experiment {

/// A folder with experiments, configs, and programs that stand in for ours: shell scripts which note that they were
/// called and write a small metrics.csv.
class ExperimentFolder : public ::testing::Test {
 protected:
  ExperimentFolder() {
    std::filesystem::create_directories(folder_ / "bin");
    for (const char* name : {"anigen-prepare", "anigen-train", "anigen-encode", "anigen-eval"}) program(name, kScript);
    place_ = {folder_ / "out", folder_ / "bin", "cpu"};
    write("train.json", R"({"trainer": {"args": {"lr": 1, "steps": 5}}})");
  }

  void write(const std::string& name, const std::string& text) { std::ofstream(folder_ / name) << text; }
  void program(const std::string& name, const std::string& text) {
    write("bin/" + name, text);
    std::filesystem::permissions(folder_ / ("bin/" + name), std::filesystem::perms::owner_all);
  }

  Experiment experiment(const std::string& json) {
    write("experiment.json", json);
    return read_experiment(folder_ / "experiment.json");
  }
  Plan plan(const std::string& json) { return make_plan(experiment(json), place_); }

  template <typename Body>
  static std::string error_of(Body body) {
    try {
      body();
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  }

  static const Job& job_of(const Plan& plan, std::size_t run, std::string_view step) {
    return plan.jobs[plan.runs[run].jobs.at(std::string(step))];
  }

  /// Lines of calls.txt that begin with a program's name.
  std::size_t calls(const std::string& name) const {
    std::ifstream stream(folder_ / "calls.txt");
    std::size_t count = 0;
    for (std::string line; std::getline(stream, line);) count += line.rfind(name, 0) == 0 ? 1 : 0;
    return count;
  }

  // Two variants of a training on one dataset, with an evaluation each.
  static constexpr const char kTwoVariants[] = R"({
    "title": "Two variants",
    "steps": {
      "data": {"program": "anigen-prepare", "args": {"--procedural": 3}},
      "fit": {"program": "anigen-train", "config": "train.json", "args": {"--dataset": "{data}"}},
      "score": {"program": "anigen-eval", "args": {"--pred": "ours={fit}", "--dataset": "{data}"}}
    },
    "variants": {"plain": {}, "fast": {"fit": {"set": {"trainer.args.lr": 2}}}},
    "seeds": [0, 1], "seeded": ["fit"],
    "tables": [{"title": "Scores", "step": "score", "columns": [{"key": "j2j", "better": "lower"}]}],
    "curves": [{"title": "Loss", "step": "fit", "column": "loss"}]
  })";

  test::TemporaryFolder folder_;
  Workplace place_;

 private:
  // Writes into what follows --output; a file "fail" or "wait" beside the programs says how it ends, and one called
  // "refuse" has the option that no program takes.
  static constexpr const char kScript[] = R"sh(#!/bin/bash
trap 'echo saved; exit 130' TERM
root=$(dirname "$(dirname "$0")")
case " $* " in *" --check-options "*)
  [ -e "$root/refuse" ] || exit 0
  case " $* " in *" $(cat "$root/refuse") "*) echo "error: $(cat "$root/refuse"): no such option"; exit 2 ;; esac
  exit 0 ;;
esac
echo "$(basename "$0") $*" >> "$root/calls.txt"
out= previous=
for word in "$@"; do
  case $previous in --output) out=$word ;; esac
  previous=$word
done
echo "at work"
if [ -e "$root/wait" ]; then while true; do sleep 0.05; done; fi
if [ -e "$root/fail" ] && [ "$(cat "$root/fail")" = "$(basename "$0")" ]; then echo "error: as asked"; exit 3; fi
if [ -n "$out" ]; then
  mkdir -p "$out"
  printf 'step,loss\n1,4\n2,3\n' > "$out/metrics.csv"
  if [ "$(basename "$0")" = anigen-eval ]; then
    printf 'id,method,failure,j2j\n' > "$out/metrics.csv"
    for i in 1 2 3 4 5 6 7; do printf '%s,ours,,0.%s\n' "$i" "$((i + ${#out} % 2))" >> "$out/metrics.csv"; done
  fi
fi
exit 0
)sh";
};

}  // namespace anigen::experiment
