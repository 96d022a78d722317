//! The distance from a place to the triangles of a mesh.

use cloud::Bounds;
use glam::DVec3;

/// The most triangles of a leaf.
const LEAF: usize = 4;

/// Triangles in a tree of boxes.
#[derive(Default)]
pub struct TriangleTree {
    /// The corners, leaf by leaf.
    triangles: Vec<[DVec3; 3]>,
    /// The boxes, each before those within it. The first one holds all.
    nodes: Vec<Node>,
}

struct Node {
    bounds: Bounds,
    /// The triangles from the first to before the last, in a leaf; else the two nodes within it.
    parts: Parts,
}

enum Parts {
    Triangles(usize, usize),
    Nodes(usize, usize),
}

impl TriangleTree {
    /// Triangles with a corner that is not finite are left out.
    pub fn new(mut triangles: Vec<[DVec3; 3]>) -> Self {
        triangles.retain(|triangle| triangle.iter().all(|corner| corner.is_finite()));
        let mut tree = Self { triangles, nodes: Vec::new() };
        if !tree.is_empty() {
            tree.split(0, tree.triangles.len());
        }
        tree
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Makes the node of some triangles, and returns its number.
    fn split(&mut self, first: usize, last: usize) -> usize {
        let own = &mut self.triangles[first..last];
        let (mut bounds, mut middles) = (Bounds::EMPTY, Bounds::EMPTY);
        let middle = |triangle: &[DVec3; 3]| (triangle[0] + triangle[1] + triangle[2]) / 3.0;
        for triangle in own.iter() {
            triangle.iter().for_each(|corner| bounds.include(*corner));
            middles.include(middle(triangle));
        }
        let number = self.nodes.len();
        self.nodes.push(Node { bounds, parts: Parts::Triangles(first, last) });
        if last - first > LEAF {
            let axis = middles.size().max_position();
            let half = (last - first) / 2;
            own.select_nth_unstable_by(half, |a, b| middle(a)[axis].total_cmp(&middle(b)[axis]));
            let (low, high) = (self.split(first, first + half), self.split(first + half, last));
            self.nodes[number].parts = Parts::Nodes(low, high);
        }
        number
    }

    /// The distance from a place to the nearest point of a triangle; infinite if there is none, NaN for a place that is not
    /// finite.
    pub fn distance(&self, place: DVec3) -> f64 {
        let away = |node: usize| {
            let Bounds { min, max } = self.nodes[node].bounds;
            place.distance_squared(place.clamp(min, max))
        };
        if !place.is_finite() {
            return f64::NAN;
        }
        let mut nearest = f64::INFINITY;
        let mut waiting = if self.is_empty() { Vec::new() } else { vec![(away(0), 0)] };
        while let Some((least, node)) = waiting.pop() {
            if least >= nearest {
                continue;
            }
            match self.nodes[node].parts {
                Parts::Triangles(first, last) => {
                    for triangle in &self.triangles[first..last] {
                        nearest = nearest.min(place.distance_squared(nearest_on(*triangle, place)));
                    }
                }
                Parts::Nodes(low, high) => {
                    let [near, far] = [low, high].map(|node| (away(node), node));
                    let (near, far) = if near.0 <= far.0 { (near, far) } else { (far, near) };
                    waiting.extend([far, near]);
                }
            }
        }
        nearest.sqrt()
    }
}

/// The point of a triangle that is nearest to a place (Ericson, Real-Time Collision Detection, 5.1.5).
fn nearest_on([a, b, c]: [DVec3; 3], place: DVec3) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    let from_a = place - a;
    let (d1, d2) = (ab.dot(from_a), ac.dot(from_a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let from_b = place - b;
    let (d3, d4) = (ab.dot(from_b), ac.dot(from_b));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let from_c = place - c;
    let (d5, d6) = (ab.dot(from_c), ac.dot(from_c));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    if sum > 0.0 { a + ab * (vb / sum) + ac * (vc / sum) } else { a }
}

#[cfg(test)]
mod tests {
    use cloud::Random;

    use super::*;

    #[test]
    fn distances_to_a_square_are_those_of_the_closed_form() {
        let [a, b, c, d] = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let tree = TriangleTree::new(vec![[a, b, c], [a, c, d], [a, b, DVec3::NAN]]);
        let mut random = Random(3);
        for _ in 0..2000 {
            let place = DVec3::from([(); 3].map(|()| f64::from(random.below(30_000) as u32) * 1e-3 - 10.0));
            let expected = place.distance(place.clamp(DVec3::ZERO, DVec3::new(10.0, 10.0, 0.0)));
            assert!((tree.distance(place) - expected).abs() < 1e-12, "{place}");
        }
        assert_eq!(TriangleTree::default().distance(a), f64::INFINITY);
        assert!(tree.distance(DVec3::NAN).is_nan());
    }

    #[test]
    fn the_tree_finds_the_nearest_of_many_triangles() {
        let mut random = Random(5);
        let mut place =
            |size: f64| DVec3::from([(); 3].map(|()| random.below(1 << 20) as f64 / f64::from(1 << 20) * size));
        let triangles: Vec<[DVec3; 3]> = (0..500)
            .map(|_| {
                let corner = place(20.0);
                [corner, corner + place(2.0), corner + place(2.0)]
            })
            .collect();
        let tree = TriangleTree::new(triangles.clone());
        for _ in 0..300 {
            let place = place(25.0);
            // Points of each triangle on a fine grid are never nearer, and nearly as near.
            let on = |[a, b, c]: &[DVec3; 3]| {
                let shares =
                    (0..=60).flat_map(|u| (0..=60 - u).map(move |v| (f64::from(u) / 60.0, f64::from(v) / 60.0)));
                shares.map(|(u, v)| place.distance(*a + (*b - *a) * u + (*c - *a) * v)).fold(f64::INFINITY, f64::min)
            };
            let expected = triangles.iter().map(on).fold(f64::INFINITY, f64::min);
            let found = tree.distance(place);
            assert!(found <= expected + 1e-12 && found > expected - 0.03, "{found}, expected {expected}");
        }
    }
}
