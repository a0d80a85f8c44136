#pragma once
#include <cstdint>
#include <string>

#include "anigen/train/distributed/communicator.h"

namespace anigen::train {

/// A checksum of a tensor's bits, at the speed of reading them. It changes with every bit and with the order.
/// @param flat contiguous, of 4- or 8-byte elements
std::uint64_t checksum(const torch::Tensor& flat);

/// Compares a tensor over all ranks, bit for bit (by checksum; 8 bytes per rank are sent). All ranks must call it.
/// @param moment for the message: "step 100" @throws Error on every rank, naming those that differ from most others
void require_same_parameters(Communicator& ranks, const torch::Tensor& flat, const std::string& moment);

}  // namespace anigen::train
