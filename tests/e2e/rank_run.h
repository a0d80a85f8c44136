#pragma once
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "tests/e2e/other_program.h"
#include "tests/train/distributed/skin_stage_config.h"

namespace anigen::test {

/// Runs of kSkinStageConfig by anigen-train, on `folder`/config.json and `folder`/data into folders beside them.
struct RankRun {
  std::string program;
  std::filesystem::path folder;

  /// Without ranks and redirection.
  std::string words(const std::string& output, const std::string& more) const {
    return quoted(program) + " --config " + quoted((folder / "config.json").string()) + " --dataset " +
           quoted((folder / "data").string()) + " --output " + quoted((folder / output).string()) + " --threads 1 " +
           more;
  }
  std::string line(int ranks, const std::string& output, const std::string& more) const {
    return words(output, "--ranks " + std::to_string(ranks) + " --rank-timeout 30 " + more) + " >" +
           quoted(said(output).string()) + " 2>&1";
  }
  /// Output of a run.
  std::filesystem::path said(const std::string& output) const { return folder / (output + ".txt"); }
  void train(int ranks, const std::string& output, const std::string& more = "") const {
    const int code = run_program(line(ranks, output, more));
    require(code == 0, output + " failed with " + std::to_string(code) + ":\n" + read_file(said(output)));
  }
  std::string weights(const std::string& output, int step) const {
    char name[64];
    std::snprintf(name, sizeof name, "model_step%07d.safetensors", step);
    return read_file(folder / output / "ckpts" / name);
  }
  /// A column of metrics.csv.
  std::vector<double> logged(const std::string& output, const std::string& column) const {
    const CsvTable table = read_csv(folder / output / "metrics.csv");
    std::vector<double> found;
    for (std::size_t row = 0; row < table.rows.size(); ++row) found.push_back(std::stod(table.cell(row, column)));
    return found;
  }
};

}  // namespace anigen::test
