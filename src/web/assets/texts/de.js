// Alle Texte der Seiten auf Deutsch. Dieselben Schlüssel wie in den anderen Sprachen.

export default {
  frame: {
    skip: 'Zum Inhalt', pages: 'Seiten', language: 'Sprache', theme: 'Darstellung', close: 'Schließen',
    theme_system: 'System', theme_light: 'Hell', theme_dark: 'Dunkel',
    queue: 'Aufträge', upload: 'Hochladen', control: 'Passpunkte', diagnosis: 'Diagnose', dashboard: 'Übersicht', help: 'Hilfe',
    login: 'Anmelden', result: 'Ergebnis', nowhere: 'Nicht gefunden', leave: 'Abmelden',
    role_reader: 'Darf ansehen', role_operator: 'Darf hochladen, korrigieren und entscheiden', role_admin: 'Darf alles',
    failed: 'Diese Seite kann nicht gezeigt werden', unreachable: 'Der Dienst antwortet nicht ({detail})',
  },
  verdict: { green: 'Grün', yellow: 'Gelb', red: 'Rot', none: 'Kein Urteil' },
  status: { queued: 'Wartet', running: 'Läuft', succeeded: 'Fertig', failed: 'Fehlgeschlagen', cancelled: 'Abgebrochen' },
  stage: {
    interior: 'Rahmenmarken', predict: 'Vorhersage', extract: 'Geradenstücke', locate: 'Passpunkte suchen',
    resect: 'Orientierung mit Punkten', adjust: 'Ausgleichung mit Geraden', diagnose: 'Beurteilung',
  },
  nowhere: { title: 'Hier ist nichts', text: 'Keine Seite von Gable hat diese Adresse.' },
};
