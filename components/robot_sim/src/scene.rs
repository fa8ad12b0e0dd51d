//! What rays and the robot's body hit: the world as shapes of the `parry2d` geometry library.
//!
//! Decision: `parry2d` only, without its sister physics engine. The robot is the one thing that moves, on four driven
//! wheels; a rigid-body solver would add contact springs and solver noise to what is one projection here.

use parry2d::math::{Pose as Placement, Vector};
use parry2d::query::Ray;
use parry2d::shape::SharedShape;

use crate::geometry::Point;
use crate::world::{Colour, Outline, World};

const WALL_COLOUR: Colour = [196, 190, 178];

/// What a body is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A straight piece of wall.
    Wall,
    /// Something in the way.
    Obstacle,
    /// What the robot is to reach.
    Target,
}

/// A solid thing.
pub struct Body {
    shape: SharedShape,
    placement: Placement,
    /// What it is.
    pub kind: Kind,
    /// How high it is, in metres.
    pub height: f64,
    /// What the camera sees.
    pub colour: Colour,
}

/// Where a ray ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// From the ray's origin, in metres.
    pub distance: f64,
    /// Index of the body in [`Scene::bodies`].
    pub body: usize,
    /// How squarely the ray meets the surface: 1 head on, 0 grazing.
    pub squareness: f64,
}

/// All solid things of a world.
pub struct Scene {
    bodies: Vec<Body>,
}

impl Scene {
    /// The shapes of `world`.
    #[must_use]
    pub fn new(world: &World) -> Self {
        let walls = world.walls.iter().flat_map(|line| line.windows(2)).map(|ends| wall(ends, world.wall_height));
        let obstacles = world.obstacles.iter().map(|obstacle| {
            let (shape, placement) = shape(&obstacle.outline);
            Body { shape, placement, kind: Kind::Obstacle, height: obstacle.height, colour: obstacle.colour }
        });
        let target = &world.target;
        let (post, placement) = shape(&Outline::Round { x: target.x, y: target.y, radius: target.radius });
        let target = Body { shape: post, placement, kind: Kind::Target, height: target.height, colour: target.colour };
        Self { bodies: walls.chain(obstacles).chain([target]).collect() }
    }

    /// The solid things.
    #[must_use]
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// Distance from `origin` in the direction `angle` (radians) to the nearest thing within `reach`, in metres.
    #[must_use]
    pub fn nearest(&self, origin: Point, angle: f64, reach: f64) -> Option<f64> {
        let ray = ray(origin, angle);
        let distances =
            self.bodies.iter().filter_map(|body| body.shape.cast_ray(&body.placement, &ray, reach as f32, true));
        distances.min_by(f32::total_cmp).map(f64::from)
    }

    /// Everything a ray goes through within `reach` metres, farthest first, as a painter wants it.
    pub fn along(&self, origin: Point, angle: f64, reach: f64, hits: &mut Vec<Hit>) {
        hits.clear();
        let ray = ray(origin, angle);
        for (index, body) in self.bodies.iter().enumerate() {
            let meets = body.shape.cast_ray_and_get_normal(&body.placement, &ray, reach as f32, true);
            hits.extend(meets.map(|meets| Hit {
                distance: f64::from(meets.time_of_impact),
                body: index,
                squareness: f64::from(meets.normal.dot(ray.dir).abs()),
            }));
        }
        hits.sort_by(|near, far| far.distance.total_cmp(&near.distance));
    }

    /// Distance from `place` to the nearest surface, in metres; negative inside a thing.
    #[must_use]
    pub fn clearance(&self, place: Point) -> f64 {
        self.bodies.iter().map(|body| body.depth(place).0).fold(f64::INFINITY, f64::min)
    }

    /// `centre` of a circle of `radius` metres, pushed out of all things, and whether it touched any.
    #[must_use]
    pub fn push_out(&self, centre: Point, radius: f64) -> (Point, bool) {
        let (mut centre, mut touched) = (centre, false);
        // Twice, because leaving one thing may lead into its neighbour (a corner).
        for body in self.bodies.iter().chain(&self.bodies) {
            let (distance, away) = body.depth(centre);
            if distance < radius {
                centre = centre.towards(away, radius - distance);
                touched = true;
            }
        }
        (centre, touched)
    }
}

impl Body {
    /// Signed distance from `place` to the surface (metres, negative inside) and the way out (radians).
    fn depth(&self, place: Point) -> (f64, f64) {
        let onto = self.shape.project_point(&self.placement, vector(place), false);
        if !onto.point.is_finite() {
            // The very centre of a circle has no nearest point; a place beside it has.
            return self.depth(Point { x: place.x + 1e-3, ..place });
        }
        let surface = Point { x: f64::from(onto.point.x), y: f64::from(onto.point.y) };
        if onto.is_inside {
            (-place.distance(surface), place.bearing(surface))
        } else {
            (place.distance(surface), surface.bearing(place))
        }
    }
}

fn ray(origin: Point, angle: f64) -> Ray {
    Ray::new(vector(origin), Vector::new(angle.cos() as f32, angle.sin() as f32))
}

fn vector(point: Point) -> Vector {
    Vector::new(point.x as f32, point.y as f32)
}

fn wall(ends: &[(f64, f64)], height: f64) -> Body {
    let end = |index: usize| vector(Point { x: ends[index].0, y: ends[index].1 });
    let shape = SharedShape::segment(end(0), end(1));
    Body { shape, placement: Placement::identity(), kind: Kind::Wall, height, colour: WALL_COLOUR }
}

fn shape(outline: &Outline) -> (SharedShape, Placement) {
    match *outline {
        Outline::Round { x, y, radius } => {
            (SharedShape::ball(radius as f32), Placement::new(vector(Point { x, y }), 0.0))
        }
        Outline::Box { x, y, width, depth, turn } => (
            SharedShape::cuboid(width as f32 / 2.0, depth as f32 / 2.0),
            Placement::new(vector(Point { x, y }), turn.to_radians() as f32),
        ),
    }
}
