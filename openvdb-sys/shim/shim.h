/* What cardioid needs of OpenVDB, in C. Every string is UTF-8, except that a path has whatever bytes the system takes.
 * No function throws, or keeps a pointer it was given. */
#ifndef CARDIOID_OPENVDB_SHIM_H
#define CARDIOID_OPENVDB_SHIM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/// Why a function failed.
typedef struct VdbError {
  /// What OpenVDB says of it, NUL-terminated, cut where it is too long.
  char text[1024];
} VdbError;

/// What a grid holds.
typedef enum VdbClass {
  /// Whatever its author did not say.
  VDB_CLASS_UNKNOWN = 0,
  VDB_CLASS_FOG_VOLUME = 1,
  VDB_CLASS_LEVEL_SET = 2,
  /// Staggered vectors.
  VDB_CLASS_STAGGERED = 3,
} VdbClass;

/// Description of a grid.
typedef struct VdbInfo {
  /// NUL-terminated, cut where it is too long.
  char name[256];
  /// OpenVDB's word for the type of its voxels, as "float".
  char value_type[64];
  VdbClass grid_class;
  /// True where voxels are float (or half in the file), so that the grid can be read.
  bool is_float;
  /// True where the transform is affine.
  bool is_linear;
  /// From voxel centres with whole coordinates to the world: images of the three axes, and of the origin.
  double to_world[12];
} VdbInfo;

/// Version of the OpenVDB that is loaded: major * 10000 + minor * 100 + patch.
int32_t vdb_version(void);

/// What was read of a file. To be closed.
typedef struct VdbFile VdbFile;

/// Reads the file whole. Null where it cannot be read.
VdbFile* vdb_open(const char* path, VdbError* error);
void vdb_close(VdbFile* file);
int32_t vdb_grid_count(const VdbFile* file);
/// False where there is no grid of this number.
bool vdb_grid_info(const VdbFile* file, int32_t number, VdbInfo* info);

/// A grid of floats. To be freed; it outlives its file.
typedef struct VdbGrid VdbGrid;

/// Null where there is none of this number, or it is not of floats.
VdbGrid* vdb_grid_open(VdbFile* file, int32_t number, VdbError* error);
void vdb_grid_free(VdbGrid* grid);

/// Value where there are no voxels.
float vdb_grid_background(const VdbGrid* grid);

/// The next leaf: its first voxel, and 512 values, z fastest. False after the last one.
bool vdb_grid_next_leaf(VdbGrid* grid, int32_t* origin, float* values);

/// The next tile of one value that is larger than a voxel and active: its first voxel, and its length. False after the last one.
bool vdb_grid_next_tile(VdbGrid* grid, int32_t* origin, int32_t* side, float* value);

/// A grid to write, for tests.
typedef struct VdbDense {
  const char* name;
  /// First voxel, and how many there are along each axis; z fastest.
  int32_t origin[3];
  int32_t size[3];
  const float* values;
  double to_world[12];
  VdbClass grid_class;
  /// Halves in the file.
  bool is_half;
} VdbDense;

/// Writes a file with one grid of floats; zero voxels are left out. False where it cannot be written.
bool vdb_write(const char* path, const VdbDense* grid, VdbError* error);

#ifdef __cplusplus
}
#endif

#endif
