#pragma once
/// Procedural creatures: bodies of primitives with skeleton, skin weights, colours and motion. body.h is what a
/// family builds; parts.h lists the families.
#include "anigen/creatures/body.h"
#include "anigen/creatures/parts.h"
#include "anigen/creatures/shapes.h"
#include "anigen/creatures/surface.h"
