#include "anigen/train/distributed/same_parameters.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <string>
#include <vector>

namespace anigen::train {
namespace {

constexpr std::size_t kLanes = 4;  // independent chains of multiplications
constexpr std::uint64_t kPrime = 0x100000001b3ULL, kStart = 0xcbf29ce484222325ULL;  // of FNV-1a

std::uint64_t mixed(std::uint64_t hash, std::uint64_t word) {
  hash = (hash ^ word) * kPrime;
  return hash ^ (hash >> 29);
}

}  // namespace

std::uint64_t checksum(const torch::Tensor& flat) {
  const torch::Tensor values = flat.detach().to(torch::kCPU).contiguous();
  const char* bytes = static_cast<const char*>(values.data_ptr());
  const std::size_t size = static_cast<std::size_t>(values.nbytes()), word = sizeof(std::uint64_t);
  std::uint64_t lanes[kLanes];
  for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] = kStart + lane;
  const auto read = [&](std::size_t at) {
    std::uint64_t value = 0;
    std::memcpy(&value, bytes + at, std::min(word, size - at));
    return value;
  };
  std::size_t at = 0;
  for (; at + kLanes * word <= size; at += kLanes * word) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] = mixed(lanes[lane], read(at + lane * word));
  }
  for (; at < size; at += word) lanes[0] = mixed(lanes[0], read(at));
  std::uint64_t hash = kStart ^ size;
  for (const std::uint64_t lane : lanes) hash = mixed(hash, lane);
  return hash;
}

void require_same_parameters(Communicator& ranks, const torch::Tensor& flat, const std::string& moment) {
  if (ranks.size() == 1) return;
  const std::vector<std::string> sums = ranks.gather(std::to_string(checksum(flat)));
  std::map<std::string, int> votes;
  for (const std::string& sum : sums) ++votes[sum];
  if (votes.size() == 1) return;
  std::string usual = sums.front();  // of as many as any other: rank 0's
  for (const auto& [sum, count] : votes) {
    if (count > votes[usual]) usual = sum;
  }
  std::string different;
  for (std::size_t rank = 0; rank < sums.size(); ++rank) {
    if (sums[rank] != usual) different += (different.empty() ? "" : ", ") + std::to_string(rank);
  }
  throw Error(moment + ": parameters are no longer the same on all ranks; those of rank " + different +
              " differ from the others'. Nothing was saved since; start again from the last checkpoint");
}

}  // namespace anigen::train
