// Trains, kills the program at random moments, resumes, and compares the end with an uninterrupted run, bit for bit.
//   kill_and_resume <anigen-train>        KILLS=10 in the environment for more than the default of 3
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/random.h"
#include "anigen/io/safetensors.h"
#include "tests/e2e/other_program.h"
#include "tests/loaders/synthetic_dataset.h"
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

  pid_t start(const std::string& output) const {
    return anigen::test::start_program(quoted(program) + " --config " + quoted((folder / "config.json").string()) +
                                       " --data-dir " + quoted((folder / "data").string()) + " --output " +
                                       quoted((folder / output).string()) + " --threads 2 --quiet");
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
  for (std::size_t i = 0; i < x.size(); ++i) {
    require(x[i].first == y[i].first && x[i].second.bytes == y[i].second.bytes, "state " + x[i].first + " differs");
  }
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
