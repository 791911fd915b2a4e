//! Small models of every kind, sound and with lies in them.

use crate::common::grids::{self, SMALL_GRIDS, SmallGrid, Values};
use crate::common::models::{is_typed, small, used};
use mipvog::model::field::Grid;

/// A grid, the part that lies, and the lie.
type LieCase = (fn() -> SmallGrid, &'static str, fn(&mut SmallGrid));

#[test]
fn small_models_of_every_kind_are_read_and_lies_are_refused() {
    for make in SMALL_GRIDS {
        used(&make()).expect("sound");
    }
    let lies: [LieCase; 24] = [
        (grids::plenoxels, "a link beyond the rows", |grid| {
            if let Values::I32(links) = &mut grid.array("links").2 {
                links[4] = 30;
            }
        }),
        (grids::plenoxels, "fewer rows of colour", |grid| {
            *grid.array("sh_data") = ("sh_data", vec![29, 12], Values::F32(vec![0.0; 348]));
        }),
        (grids::plenoxels, "no number of functions", |grid| {
            *grid.array("sh_data") = ("sh_data", vec![30, 15], Values::F32(vec![0.0; 450]));
        }),
        (grids::plenoxels, "a density that is no number", |grid| {
            if let Values::F32(values) = &mut grid.array("density_data").2 {
                values[3] = f32::NAN;
            }
        }),
        (grids::plenoxels, "a box without extent", |grid| {
            *grid.array("radius") = ("radius", vec![3], Values::F32(vec![1.0, 0.0, 1.0]));
        }),
        (grids::plenoxels, "a box thinner than any", |grid| {
            *grid.array("radius") = ("radius", vec![3], Values::F32(vec![1.0, 1e-20, 1.0]));
        }),
        (grids::plenoxels, "a texture as basis", |grid| {
            grid.arrays.push(("basis_type", Vec::new(), Values::I32(vec![4])));
        }),
        (grids::spheres, "a link beyond the rows", |grid| {
            if let Values::I32(links) = &mut grid.array("background_links").2 {
                links[4] = 12;
            }
        }),
        (grids::spheres, "directions without links", |grid| {
            grid.arrays.retain(|array| array.0 != "background_links");
        }),
        (grids::spheres, "directions that are no sphere", |grid| {
            grid.array("background_links").1 = vec![3, 6];
        }),
        (grids::spheres, "a single layer", |grid| {
            grid.array("background_data").1 = vec![48, 1, 4];
        }),
        (grids::spheres, "colours without density", |grid| {
            grid.array("background_data").1 = vec![16, 4, 3];
        }),
        (grids::spheres, "a background that is no number", |grid| {
            if let Values::F32(values) = &mut grid.array("background_data").2 {
                values[7] = f32::INFINITY;
            }
        }),
        (grids::lightning_spheres, "scales of other layers", |grid| {
            *grid.array("model.background_data_min") =
                ("model.background_data_min", vec![4], Values::F32(vec![0.0; 4]));
        }),
        (grids::lightning, "a cell beyond any grid", |grid| {
            *grid.array("state_dict.model.links_idx") =
                ("state_dict.model.links_idx", vec![30], Values::I32(vec![-5; 30]));
        }),
        (grids::lightning, "scales of other columns", |grid| {
            *grid.array("model.sh_data_min") =
                ("model.sh_data_min", vec![2], Values::F32(vec![0.0; 2]));
        }),
        (grids::sampled, "a box inside out", |grid| {
            if let Values::F32(corners) = &mut grid.array("aabb").2 {
                corners[0] = 7.0;
            }
        }),
        (grids::sampled, "an unknown clamp", |grid| grid.settings[0] = ("clamp", "tanh")),
        (grids::sampled_blocks, "a block twice", |grid| {
            *grid.array("blocks") = ("blocks", vec![2, 3], Values::I32(vec![0; 6]));
        }),
        (grids::sampled_blocks, "a block before the first", |grid| {
            *grid.array("blocks") = ("blocks", vec![2, 3], Values::I32(vec![0, 0, 0, 0, -1, 0]));
        }),
        (grids::plenoctree, "a node that is its own child", |grid| {
            if let Values::I32(children) = &mut grid.array("child").2 {
                children[9] = 0;
                children[10] = -1;
            }
        }),
        (grids::plenoctree, "a node as a child twice", |grid| {
            if let Values::I32(children) = &mut grid.array("child").2 {
                children[2] = 1;
            }
        }),
        (grids::plenoctree, "a child beyond the nodes", |grid| {
            if let Values::I32(children) = &mut grid.array("child").2 {
                children[2] = 3;
            }
        }),
        (grids::quantized, "an entry beyond the code book", |grid| {
            if let Values::U16(entries) = &mut grid.array("quant_map").2 {
                entries.fill(5);
            }
        }),
    ];
    for (make, name, lie) in lies {
        let mut grid = make();
        lie(&mut grid);
        let error = match used(&grid) {
            Ok(()) => panic!("{name} passes"),
            Err(error) => error,
        };
        // Values that are no numbers are refused by a bake, which reads nodes.
        assert!(is_typed(&error), "{name}: {error}");
    }
}

#[test]
fn quantized_checkpoints_hold_the_values_that_their_codes_stand_for() {
    let grid = grids::lightning();
    let (Values::U8(codes), Values::F32(density)) = (&grid.arrays[2].2, &grid.arrays[1].2) else {
        panic!("codes and densities")
    };
    let field = small(&grid).expect("sound").field;
    assert_eq!(field.scene.nodes.0, [18; 3], "16 cells and a border");
    let plane = |grid: &Grid, channel, x| {
        let mut plane = vec![0.0; 18 * 18];
        grid.read_plane(channel, x, &mut plane, |_| {}).expect("a plane");
        plane
    };
    for row in 0..30 {
        let cell = 4000 - 97 * row;
        let [x, y, z] = [cell / 256, cell / 16 % 16, cell % 16].map(|at| at + 1);
        assert_eq!(plane(&field.density, 0, x)[y * 18 + z], density[row]);
        for channel in 0..12 {
            // Function by function here, colour by colour there.
            let column = channel % 3 * 4 + channel / 3;
            let expected = f32::from(codes[12 * row + column]) / 128.0 - 1.0;
            assert_eq!(plane(&field.color[0], channel, x)[y * 18 + z], expected);
        }
    }
    let empty = plane(&field.color[0], 0, 1);
    assert!(empty.iter().filter(|value| **value == 0.0).count() > 300, "empty cells hold zeros");
}
