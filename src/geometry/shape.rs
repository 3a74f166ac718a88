use super::Vec2;

/// The point of the segment `a`–`b` nearest to `p`, m. A segment of length zero is its point.
pub fn closest_point_on_segment(p: Vec2, a: Vec2, b: Vec2) -> Vec2 {
    let ab = b - a;
    let length_sq = ab.norm_squared();
    if length_sq == 0.0 {
        return a;
    }
    a + ab * ((p - a).dot(&ab) / length_sq).clamp(0.0, 1.0)
}

/// Distance between the segments `a`–`b` and `c`–`d`, m; 0 when they cross.
pub fn segment_distance(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> f64 {
    let side = |p: Vec2, q: Vec2, r: Vec2| (q - p).perp(&(r - p));
    let (c_side, d_side) = (side(a, b, c), side(a, b, d));
    let (a_side, b_side) = (side(c, d, a), side(c, d, b));
    if c_side * d_side < 0.0 && a_side * b_side < 0.0 {
        return 0.0;
    }
    let to = |p: Vec2, q: Vec2, r: Vec2| (p - closest_point_on_segment(p, q, r)).norm();
    to(c, a, b).min(to(d, a, b)).min(to(a, c, d)).min(to(b, c, d))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_point_is_clamped_to_the_ends() {
        let (a, b) = (Vec2::new(0.0, 0.0), Vec2::new(2.0, 0.0));
        assert_eq!(closest_point_on_segment(Vec2::new(-1.0, 1.0), a, b), a);
        assert_eq!(closest_point_on_segment(Vec2::new(3.0, 1.0), a, b), b);
        assert_eq!(closest_point_on_segment(Vec2::new(0.5, 1.0), a, b), Vec2::new(0.5, 0.0));
        assert_eq!(closest_point_on_segment(Vec2::new(0.5, 1.0), a, a), a);
    }

    #[test]
    fn segments_cross_touch_or_stay_apart() {
        let v = Vec2::new;
        assert_eq!(segment_distance(v(0.0, -1.0), v(0.0, 1.0), v(-1.0, 0.0), v(1.0, 0.0)), 0.0);
        assert_eq!(segment_distance(v(0.0, 0.0), v(1.0, 0.0), v(1.0, 0.0), v(2.0, 5.0)), 0.0);
        assert_eq!(segment_distance(v(0.0, 0.0), v(1.0, 0.0), v(0.0, 2.0), v(1.0, 3.0)), 2.0);
    }
}
