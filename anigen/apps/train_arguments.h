#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace anigen {

/// The command line of anigen-train.
struct TrainArguments {
  std::vector<std::string> words;  ///< argv
  std::filesystem::path config, output, load;
  std::string dataset, ckpt = "latest", warm_start;
  std::vector<std::string> overrides;
  bool restart = false, schema = false, print_config = false, tune = false;
  std::int64_t profile_steps = 0, extend_to = 0;
  // Several processes.
  int ranks = 1, rank_restarts = 0;
  double rank_timeout = 60.0;  ///< seconds without a sign of life after which a rank is lost
  std::string rendezvous, communication = "fp32";
  bool ranks_given = false;
  std::vector<std::string> only_of_ranks;  ///< options that were given and mean something to several processes alone
};

}  // namespace anigen
