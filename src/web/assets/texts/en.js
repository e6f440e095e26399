// Every text of the pages in English. The same keys as in the other languages: `tests/pages.rs` holds them together.

export default {
  frame: {
    skip: 'To the content', pages: 'Pages', language: 'Language', theme: 'Theme', close: 'Close',
    theme_system: 'System', theme_light: 'Light', theme_dark: 'Dark',
    queue: 'Queue', upload: 'Upload', control: 'Control', diagnosis: 'Diagnosis', dashboard: 'Dashboard', help: 'Help',
    login: 'Log in', result: 'Result', nowhere: 'Not found', leave: 'Log out',
    role_reader: 'May look', role_operator: 'May upload, correct and decide', role_admin: 'May do everything',
    failed: 'This page cannot be shown', unreachable: 'The service does not answer ({detail})',
  },
  verdict: { green: 'Green', yellow: 'Yellow', red: 'Red', none: 'No verdict' },
  status: { queued: 'Waiting', running: 'Running', succeeded: 'Done', failed: 'Failed', cancelled: 'Cancelled' },
  stage: {
    interior: 'Fiducial marks', predict: 'Predict', extract: 'Line segments', locate: 'Locate control points',
    resect: 'Orient with points', adjust: 'Adjust with lines', diagnose: 'Judge',
  },
  nowhere: { title: 'There is nothing here', text: 'No page of Gable has this address.' },
};
