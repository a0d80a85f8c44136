#pragma once
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/lease.h"

namespace anigen {

/// Asks for one piece of the work. @return its lease; nothing when somebody else has it or has done it. For several
/// threads if `done` of work_together() is
using Claim = std::function<std::optional<Lease>(std::size_t piece)>;

/// Takes some pieces to work on: claims each once, in any order and from any thread, and does what it gets.
using WorkPass = std::function<void(const std::vector<std::size_t>& pieces, const Claim& claim)>;

/// Work that any number of processes share by leases: each takes what nobody else has, until every piece is done, here
/// or elsewhere. Pieces of a process that died are taken over; who finds nothing to take waits for those who work, so
/// that the end is the end of all the work, whoever is left to see it.
/// @param names of the pieces; the same for everybody
/// @param done whether a piece is done, by whomever; asked before a lease is taken and again under it. A piece that was
/// claimed here counts as done here afterwards, whatever this says: a failure is not tried twice
/// @throws Interrupted after Ctrl-C; what `pass` throws
void work_together(const LeaseFolder& leases, const std::vector<std::string>& names,
                   const std::function<bool(std::size_t)>& done, const WorkPass& pass);

/// The same one piece after the other. @param work is called under the lease
void work_in_turn(const LeaseFolder& leases, const std::vector<std::string>& names,
                  const std::function<bool(std::size_t)>& done, const std::function<void(std::size_t)>& work);

}  // namespace anigen
