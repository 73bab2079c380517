/* Mesh cells on the raster of nodes: owners of nodes, heights of borders, draining and copying of cells.
 *
 * Node (column, row) of a level stands (column, row) · SIDE · 2^level mesh units from the origin. A node's
 * place is row, column and half of its triangle, and its nearest and second corner; the first one is its
 * cell's site.
 */
#pragma once

#include "mesh.h"

/* Rasters of one level around some cells, from node (column, row) on. */
typedef struct {
    int64_t rows;
    int64_t columns;
    int64_t count; /* of cells */
    int64_t level;
    int64_t column;
    int64_t row;
    const int32_t *owner; /* [rows][columns], a cell's number, -1 outside of them */
    const double *base; /* [rows][columns], heights of nodes on borders, m, NaN elsewhere */
    const double *uplift; /* [rows][columns] */
    const double *repose; /* [rows][columns] */
    const double *inflow; /* [rows][columns], area that drains from other cells into nodes on borders, m² */
    const int64_t *boxes; /* [count][4], first row and column and ends of each cell, 0 of one without nodes */
} CellNodes;

/* Places of nodes, from node (column, row) on, on borders that are displaced by noise. The third barycentric
 * coordinate is 0 on a border half way between vertices and 1/3 at one; the first exceeds the second by
 * `away`, 0 on the border and 1 at the site. */
HOST void node_places(
    const MeshParameters *mesh, const MeshTable *table, int64_t level, int64_t column, int64_t row,
    int64_t rows, int64_t columns, int32_t place[restrict rows][columns][5],
    double third[restrict rows][columns], double away[restrict rows][columns],
    double scratch[restrict 2][columns]);

/* Boxes (west, south, east, north) of the cells of a table's inner sites, from its first lattice point; 0 of
 * others. */
HOST void cell_bounds(
    const MeshTable *table,
    double bounds[restrict table->rows][table->columns][4]); /* L */

/* Heights of nodes between the edges of their cells and crests at the sites, which rise above the edges by
 * shares of the relief at the site. */
HOST void mesh_heights(
    const MeshTable *table, const PassRule *rule, double rise, int64_t rows, int64_t columns,
    const int32_t place[restrict rows][columns][5], const double third[restrict rows][columns],
    const double away[restrict rows][columns],
    double height[restrict rows][columns]); /* m */

/* Owners of nodes and boxes of cells, as in `CellNodes`. Heights of edges and areas that drain into them from
 * above, at nodes that have an 8-neighbour of another cell; others, and those of no cell, get NaN and 0. */
HOST void cell_borders(
    const MeshTable *table, const PassRule *rule, int64_t rows, int64_t columns, int64_t count,
    const int32_t place[restrict rows][columns][5], const double third[restrict rows][columns],
    const int32_t number[restrict table->rows + 1][table->columns + 1], /* of the cell of each site, or -1 */
    int32_t owner[restrict rows][columns],
    double base[restrict rows][columns], /* m */
    double inflow[restrict rows][columns], /* m² */
    int64_t boxes[restrict count][4]);

/* Drain cells, each alone. Arrays of nodes hold one cell's box after the other. */
HOST void drain_cells(
    const CellNodes *cells, int64_t coarse_nodes,
    const double coarse[restrict coarse_nodes], /* heights at the next coarser level, m */
    const int64_t starts[restrict cells->count][4], /* its rows and columns (none: 0), first row and column */
    double finest, /* spacing of level 0, m */
    const int64_t rounds[restrict cells->count],
    int64_t first_rounds, double first_uplift, /* before, where there is no coarser level: even uplift */
    double talus, /* greatest slope below passes, over that of hillslopes */
    int64_t nodes,
    double height[restrict nodes], /* m, NaN outside of the cell, as all others 0 */
    double piled[restrict nodes], /* the same with talus */
    float area[restrict nodes], /* m² */
    float wet[restrict nodes], /* 0 … 1 */
    int64_t room, double scratch[restrict room]); /* 19 (rows + 2) (columns + 2) of the largest cell */

/* Copy the nodes of a cell into a window, where its first one is (row, column). */
HOST void paste_cell(
    int64_t cell_rows, int64_t cell_columns,
    const double cell_height[restrict cell_rows][cell_columns], /* m, NaN outside of the cell */
    const float cell_area[restrict cell_rows][cell_columns],
    const float cell_wet[restrict cell_rows][cell_columns],
    int64_t row, int64_t column, int64_t rows, int64_t columns, double height[restrict rows][columns],
    float area[restrict rows][columns], float wet[restrict rows][columns]);
