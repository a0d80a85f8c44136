// The two stages of the sparse structure as a user runs them, on creatures made on the spot: prepare, train the
// auto-encoder of configs/tiny/ss_dae.json, encode, train the flow of configs/tiny/ss_flow.json, generate from
// pictures. Fewer steps and a coarser grid than the configs have; the losses must follow the curves that these settings
// gave when the test was written, and the reconstructions must reach a floor.
//   tiny_sparse_structure <anigen-prepare> <anigen-train> <anigen-encode> <anigen-eval> <configs/tiny>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;

void call(const std::string& command) {
  std::printf("> %s\n", command.c_str());
  std::fflush(stdout);
  if (std::system(command.c_str()) != 0) throw std::runtime_error("failed: " + command);
}

std::string settings(const std::vector<std::string>& overrides) {
  std::string words;
  for (const std::string& setting : overrides) words += " --set " + setting;
  return words;
}

struct Point {
  long step;
  double value;
};

/// One column of metrics.csv wherever it has a value.
std::vector<Point> curve(const fs::path& run, const std::string& column) {
  const anigen::CsvTable table = anigen::read_csv(run / "metrics.csv");
  std::vector<Point> points;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    const std::string& text = table.cell(row, column);
    if (!text.empty()) points.push_back({std::stol(table.cell(row, "step")), std::stod(text)});
  }
  return points;
}

/// Losses are means over many voxels and samples, so that other roundings (threads, BLAS, processor) move them little;
/// another draw of data, noise or initial weights moves them by more than this.
bool expect_curve(const fs::path& run, const std::vector<Point>& golden, double tolerance) {
  const std::vector<Point> found = curve(run, "loss.total");
  if (found.size() != golden.size()) throw std::runtime_error(run.string() + ": another number of logged losses");
  bool good = true;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const bool near = found[i].step == golden[i].step &&
                      std::abs(found[i].value - golden[i].value) <= tolerance * std::abs(golden[i].value);
    std::printf("step %ld: loss %.5f, golden %.5f%s\n", found[i].step, found[i].value, golden[i].value,
                near ? "" : "  <- differs");
    good = good && near;
  }
  return good;
}

bool expect_at_least(const fs::path& run, const std::string& column, double floor) {
  const std::vector<Point> found = curve(run, column);
  if (found.empty()) throw std::runtime_error(run.string() + ": no " + column);
  std::printf("%s: %.4f, floor %.2f\n", column.c_str(), found.back().value, floor);
  return found.back().value >= floor;
}

/// True when every check holds; goes on after a difference, so that one run shows them all.
bool run(const std::vector<std::string>& programs) {
  bool good = true;
  const std::string &prepare = programs[0], &train = programs[1], &encode = programs[2], &evaluate = programs[3];
  const fs::path configs = programs[4];
  const anigen::test::TemporaryFolder folder;
  const std::string data = (folder / "data").string(), coder = (folder / "ss_dae").string(),
                    flow = (folder / "ss_flow").string(), out = (folder / "out").string();
  call(prepare + " --output " + data + " --procedural 36 --procedural-test 4 --voxel-resolution 64 --cond-views 2" +
       " --cond-view-size 64 --threads 2 --quiet");

  call(train + " --config " + (configs / "ss_dae.json").string() + " --dataset " + data + " --output " + coder +
       settings({"dataset.args.resolution=32", "dataset.args.skl_dilation_iter=1", "trainer.args.max_steps=100",
                 "trainer.args.i_log=20", "trainer.args.i_eval=100", "trainer.args.i_save=100",
                 "trainer.args.i_sample=100"}) +
       " --threads 2 --quiet");
  good =
      expect_curve(coder, {{20, 1.84034}, {40, 1.58523}, {60, 1.28747}, {80, 1.09748}, {100, 1.02233}}, 0.03) && good;
  good = expect_at_least(coder, "eval.iou_shape", 0.30) && good;
  good = expect_at_least(coder, "eval.iou_skl", 0.30) && good;

  call(encode + " ss --run " + coder + " --dataset " + data + " --check --threads 2 --quiet");
  call(train + " --config " + (configs / "ss_flow.json").string() + " --dataset " + data + " --output " + flow +
       settings({"dataset.args.ss_dec_path=" + coder, "models.denoiser.args.resolution=8", "trainer.args.max_steps=20",
                 "trainer.args.i_log=5", "trainer.args.i_eval=20", "trainer.args.i_save=20", "trainer.args.i_sample=0",
                 "dataset.args.image_size=64", "trainer.args.image_encoder.image_size=64"}) +
       " --threads 2 --quiet");
  good = expect_curve(flow, {{5, 2.56806}, {10, 2.34179}, {15, 3.01806}, {20, 2.28165}}, 0.03) && good;

  call(evaluate + " --ss-flow " + flow + " --dataset " + data + " --split " + data +
       "/splits/test.txt --ss-steps 4 --output " + out + " --threads 2 --quiet");
  const anigen::Json means = anigen::read_json(fs::path(out) / "metrics.json").at("means");
  const double reached = means.at("auto-encoder").at("iou").get<double>();
  std::printf("auto-encoder's own latents: IoU %.4f, floor 0.25\n", reached);
  return good && reached >= 0.25;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6) {
    std::fprintf(stderr, "usage: %s <anigen-prepare> <anigen-train> <anigen-encode> <anigen-eval> <configs/tiny>\n",
                 argv[0]);
    return 2;
  }
  try {
    if (!run({argv + 1, argv + argc})) {
      std::fprintf(stderr, "a loss leaves its golden curve, or a result is below its floor\n");
      return 1;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
