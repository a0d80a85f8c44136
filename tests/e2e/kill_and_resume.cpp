// Trains, kills the program at random moments, resumes, and compares the end with an uninterrupted run, bit for bit.
// Then starts it again in the ways that could cost a run: from its beginning, from an earlier step, from another run,
// beside itself, and stopped by Ctrl-C.
//   kill_and_resume <anigen-train>        KILLS=10 in the environment for more than the default of 3
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "anigen/core/table.h"
#include "anigen/io/arrays/safetensors.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/e2e/other_program.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using anigen::test::quoted;
using anigen::test::require;
using Clock = std::chrono::steady_clock;

constexpr char kConfig[] = R"({
  "models": {"model": {"name": "SkinAutoEncoder", "args": {
    "encoder_config": {"skin_feat_channels": 4, "skl_pos_embed_freq": 6, "jp_embed_dim": 32,
                       "jp_embedder_config": {"hidden_dim": 32, "depth": 1, "jp_embed_attn": true}},
    "decoder_config": {"model_type": "tree", "skin_feat_channels": 4, "model_channels": 16, "num_blocks": 2}}}},
  "dataset": {"name": "AniGenSparseFeat2Skeleton", "args": {"test_mode": false}},
  "trainer": {"name": "AniGenSkinAETrainer", "args": {
    "max_steps": 150, "batch_size": 4, "batch_split": 2, "replicas": 2, "num_skin_samples": 64, "seed": 7,
    "optimizer": {"name": "AdamW", "args": {"lr": 0.003}},
    "lr_scheduler": {"name": "CosineAnnealingLR", "args": {"T_max": 150}},
    "grad_clip": {"name": "AdaptiveGradClipper", "args": {"max_norm": 1.0, "buffer_size": 20}},
    "ema_rate": [0.99], "fp16_mode": "none", "i_log": 7, "i_print": 0, "i_save": 10, "i_sample": 0,
    "augmentations": {"rotation": "so3", "merge_joints": 0.3}}}})";

struct Run {
  std::string program;
  fs::path folder;

  pid_t start(const std::string& output, const std::string& more = "") const {
    return anigen::test::start_program(quoted(program) + " --config " + quoted((folder / "config.json").string()) +
                                       " --dataset " + quoted((folder / "data").string()) + " --output " +
                                       quoted((folder / output).string()) + " --threads 2 --quiet " + more);
  }
  fs::path checkpoint(const std::string& output, int step) const {
    char name[64];
    std::snprintf(name, sizeof name, "state_step%07d.safetensors", step);
    return folder / output / "ckpts" / name;
  }
  bool has(const std::string& output, int step) const { return fs::exists(checkpoint(output, step)); }
  // Newest step that has a state; -1 without one.
  int newest(const std::string& output) const {
    int found = -1;
    std::error_code error;
    for (fs::directory_iterator entry(folder / output / "ckpts", error), end; !error && entry != end;
         entry.increment(error)) {
      const std::string name = entry->path().filename().string();
      if (name.rfind("state_step", 0) == 0 && name.find(".tmp-") == std::string::npos)
        found = std::max(found, std::stoi(name.substr(10, 7)));
    }
    return found;
  }
};

// Exit status, or minus the signal that ended the process.
int wait_for(pid_t child) {
  int status = 0;
  if (::waitpid(child, &status, 0) < 0) throw std::runtime_error("cannot wait");
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

// Whatever a kill left behind under its final name must be whole.
void check_files(const fs::path& checkpoints) {
  if (!fs::exists(checkpoints)) return;
  for (const auto& entry : fs::directory_iterator(checkpoints)) {
    const std::string name = entry.path().filename().string();
    if (name.find(".tmp-") == std::string::npos) anigen::io::read_safetensors(entry.path());
  }
}

void check_same(const fs::path& a, const fs::path& b) {
  for (const char* name : {"model_step0000150.safetensors", "model_ema0.99_step0000150.safetensors"}) {
    require(anigen::read_file(a / "ckpts" / name) == anigen::read_file(b / "ckpts" / name),
            std::string(name) + " differs");
  }
  const auto x = anigen::io::read_safetensors(a / "ckpts/state_step0000150.safetensors").tensors;
  const auto y = anigen::io::read_safetensors(b / "ckpts/state_step0000150.safetensors").tensors;
  require(x.size() == y.size(), "states hold different arrays");
  for (std::size_t i = 0; i < x.size(); ++i)
    require(x[i].first == y[i].first && x[i].second.bytes == y[i].second.bytes, "state " + x[i].first + " differs");
}

std::string steps(int most) { return " --set trainer.args.max_steps=" + std::to_string(most); }

// Steps of metrics.csv, as they stand there.
std::vector<int> logged_steps(const fs::path& folder) {
  const anigen::CsvTable table = anigen::read_csv(folder / "metrics.csv");
  std::vector<int> found;
  for (const auto& row : table.rows) found.push_back(std::stoi(row[0]));
  return found;
}

void wait_until(const std::function<bool()>& there, pid_t child, const std::string& what) {
  const Clock::time_point begin = Clock::now();
  while (!there()) {
    require(Clock::now() - begin < std::chrono::minutes(3), what + " did not come");
    int status = 0;
    require(::waitpid(child, &status, WNOHANG) == 0, "the run ended before " + what);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

void check_beginnings(const Run& train) {
  const auto finishes = [&](const std::string& output, const std::string& more) {
    const int status = wait_for(train.start(output, more));
    require(status == 0, output + " " + more + ": status " + std::to_string(status));
  };
  finishes("other", steps(20));
  finishes("run", steps(40));

  // 1. A run that begins below the checkpoints of its folder keeps its own, and theirs.
  finishes("run", "--ckpt none --restart" + steps(15));
  require(train.has("run", 15) && train.has("run", 10), "the checkpoints of the run that began again are not there");
  for (const char* step : {"30", "40"}) {
    require(fs::exists(train.folder / "run/ckpts/abandoned-30-1" /
                       ("state_step00000" + std::string(step) + ".safetensors")),
            std::string("the earlier step ") + step + " is lost");
  }
  require(logged_steps(train.folder / "run") == std::vector<int>{7, 14}, "metrics.csv holds rows of the earlier run");

  // 2. The command that began from another run goes on when it is run again.
  const std::string loads = "--load " + quoted((train.folder / "other").string()) + " --ckpt 20";
  finishes("run2", loads + steps(40));
  const std::vector<int> before = logged_steps(train.folder / "run2");
  const std::string at_40 = anigen::read_file(train.checkpoint("run2", 40));
  finishes("run2", loads + steps(50));
  require(anigen::read_file(train.checkpoint("run2", 40)) == at_40, "step 40 was trained again");
  require(logged_steps(train.folder / "run2").size() > before.size(), "nothing was added to metrics.csv");

  // 3. A run that went back does not return to the steps it left, also when it is killed and started by the same words.
  finishes("run3", steps(40));
  const std::string rewinds = "--ckpt 30 --restart --set trainer.args.seed=8" + steps(1000000);
  for (int leg = 0, reached = 30; leg < 2; ++leg) {
    const pid_t child = train.start("run3", rewinds);
    const int wanted = reached + 20;
    wait_until([&] { return train.newest("run3") >= wanted; }, child, "step " + std::to_string(wanted));
    ::kill(child, SIGKILL);
    require(wait_for(child) == -SIGKILL, "the run ended by itself");
    reached = train.newest("run3");
  }
  require(fs::exists(train.folder / "run3/ckpts/abandoned-40-1"), "step 40 of the first history is lost");
  for (const auto& entry : fs::directory_iterator(train.folder / "run3/ckpts"))
    require(!entry.is_directory() || entry.path().filename() == "abandoned-40-1", "the same restart began again");
  const std::vector<int> rows = logged_steps(train.folder / "run3");
  require(std::is_sorted(rows.begin(), rows.end()) && std::set<int>(rows.begin(), rows.end()).size() == rows.size(),
          "metrics.csv holds two histories");

  // 4. A second trainer is refused by the holder's name, and 5. Ctrl-C means that everything is saved.
  const pid_t holder = train.start("run4", steps(1000000));
  wait_until([&] { return train.newest("run4") >= 10; }, holder, "step 10");
  const fs::path said = train.folder / "second.txt";
  const int refused = wait_for(train.start("run4", steps(1000000) + " 2>" + quoted(said.string())));
  const std::string message = anigen::read_file(said);
  require(refused == 2, "a second trainer ended with status " + std::to_string(refused) + ": " + message);
  require(message.find("process " + std::to_string(holder) + " on ") != std::string::npos, message);
  ::kill(holder, SIGINT);
  require(wait_for(holder) == 130, "Ctrl-C did not end with status 130");
  const std::vector<int> last = logged_steps(train.folder / "run4");
  const int newest = train.newest("run4");
  require(!last.empty() && newest >= last.back(), "Ctrl-C lost steps that metrics.csv holds");
  finishes("run4", steps(newest + 1));
  std::printf("every way to begin kept what was there\n");
}

void run(const std::string& program, int kills) {
  const anigen::test::TemporaryFolder folder;
  const Run train{program, folder.path()};
  anigen::test::write_synthetic_dataset(folder / "data", 8);
  anigen::write_file_atomically(folder / "config.json", kConfig);

  const Clock::time_point begin = Clock::now();
  require(wait_for(train.start("whole")) == 0, "the uninterrupted run failed");
  const double whole = std::chrono::duration<double>(Clock::now() - begin).count();

  anigen::Rng rng(static_cast<std::uint64_t>(::getpid()), "kill moments");
  int delivered = 0;
  for (int attempt = 0; delivered < kills && attempt < 20 * kills; ++attempt) {
    // A run that got to its end before the kills were used up is compared, and the next one starts anew.
    const std::string output = "killed" + std::to_string(attempt);
    for (bool finished = false; !finished;) {
      const pid_t child = train.start(output);
      if (delivered < kills) {
        std::this_thread::sleep_for(std::chrono::duration<double>(rng.uniform(0.02, 0.8) * whole));
        ::kill(child, SIGKILL);
      }
      const int status = wait_for(child);
      require(status == 0 || status == -SIGKILL, "a resumed run failed with status " + std::to_string(status));
      finished = status == 0;
      delivered += status == -SIGKILL;
      check_files(folder / output / "ckpts");
    }
    check_same(folder / "whole", folder / output);
  }
  require(delivered >= kills, "too few kills hit a running program");
  std::printf("%d kills; every resumed run ended with the same bits\n", delivered);
  check_beginnings(train);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: kill_and_resume <anigen-train>\n"), 2;
  const char* kills = std::getenv("KILLS");
  try {
    run(argv[1], kills != nullptr ? std::max(1, std::atoi(kills)) : 3);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "kill_and_resume: %s\n", error.what());
    return 1;
  }
}
