#pragma once
/// Voxels with features: neighbour maps, submanifold convolution, windowed attention, blocks. support.h holds the
/// voxels of a batch, and what is computed from them once.
#include "anigen/sparse/attention.h"
#include "anigen/sparse/blocks.h"
#include "anigen/sparse/convolution.h"
#include "anigen/sparse/norms.h"
#include "anigen/sparse/support.h"
#include "anigen/sparse/windows.h"
