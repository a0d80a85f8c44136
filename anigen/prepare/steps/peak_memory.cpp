#include "anigen/prepare/steps/peak_memory.h"

#include <fstream>
#include <string>

namespace anigen::prepare {

void reset_peak_memory() {
  // 5 resets the high-water mark: proc(5), /proc/[pid]/clear_refs.
  std::ofstream("/proc/self/clear_refs") << "5";
}

std::uint64_t peak_memory_bytes() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    if (word != "VmHWM:") continue;
    std::uint64_t kibibytes = 0;
    status >> kibibytes;
    return kibibytes << 10;
  }
  return 0;
}

}  // namespace anigen::prepare
