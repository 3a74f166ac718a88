//! Where things are in the conic form.

use clarabel::algebra::CscMatrix;

/// Where things are in the conic form of `size` rows of each kind. Variables: v̂, ω̂, δ̂_p, δ̂_θ, δ̂_r.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout {
    pub(super) size: usize,
}

impl Layout {
    pub(super) const V: usize = 0;
    pub(super) const OMEGA: usize = 2;
    pub(super) const SLACK_POSITION: usize = 4;
    pub(super) const SLACK_HEADING: usize = 5;
    pub(super) const SLACK_COMFORT: usize = 6;

    pub(super) fn variables(self) -> usize {
        4 + self.size
    }
    pub(super) fn comfort(self) -> usize {
        Self::SLACK_COMFORT + self.size
    }
    pub(super) fn safety(self) -> usize {
        self.comfort() + self.size
    }
    pub(super) fn position_cone(self) -> usize {
        self.safety() + self.size
    }
    pub(super) fn heading_cone(self) -> usize {
        self.position_cone() + 3
    }
    pub(super) fn rows(self) -> usize {
        self.heading_cone() + 3
    }

    /// Index of the first comfort coefficient among the values of A (column of v̂).
    pub(super) const VALUE_COMFORT: usize = 2;
    pub(super) fn value_safety(self) -> usize {
        Self::VALUE_COMFORT + self.size
    }
    pub(super) fn value_position(self) -> usize {
        self.value_safety() + self.size
    }
    pub(super) fn value_heading(self) -> usize {
        self.value_position() + 3 + 2
    }

    /// A with its fixed sparsity; coefficients that change from solve to solve are 0.
    pub(super) fn matrix(self) -> CscMatrix<f64> {
        let (p, h) = (self.position_cone(), self.heading_cone());
        let mut columns: Vec<Vec<(usize, f64)>> = Vec::with_capacity(self.variables());
        let mut v = vec![(Self::V, 1.0), (Self::V + 1, -1.0)];
        v.extend((self.comfort()..p).map(|row| (row, 0.0)));
        v.extend((p..p + 3).map(|row| (row, 0.0)));
        columns.push(v);
        columns.push(vec![(Self::OMEGA, 1.0), (Self::OMEGA + 1, -1.0), (h, 0.0), (h + 1, 0.0), (h + 2, 0.0)]);
        columns.push(vec![(Self::SLACK_POSITION, -1.0), (p, -1.0), (p + 1, -1.0)]);
        columns.push(vec![(Self::SLACK_HEADING, -1.0), (h, -1.0), (h + 1, -1.0)]);
        columns.extend(
            (0..self.size).map(|j| vec![(Self::SLACK_COMFORT + j, -1.0), (self.comfort() + j, -1.0)]),
        );

        let mut starts = vec![0];
        let (mut rows, mut values) = (Vec::new(), Vec::new());
        for column in columns {
            rows.extend(column.iter().map(|(row, _)| *row));
            values.extend(column.iter().map(|(_, value)| *value));
            starts.push(rows.len());
        }
        CscMatrix::new(self.rows(), self.variables(), starts, rows, values)
    }
}
